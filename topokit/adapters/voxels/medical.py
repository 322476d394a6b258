"""Volumes of medicine: NIfTI and MGH through nibabel, NRRD through pynrrd, MetaImage and DICOM through SimpleITK.

Also images of nibabel, SimpleITK and MONAI in memory, which are known by their attributes.
"""

from __future__ import annotations

import locale
import math
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from topokit.adapters.voxels.announced_sizes import check_nibabel, check_nrrd
from topokit.adapters.voxels.chosen_part import Entry
from topokit.adapters.voxels.entry import is_dicom
from topokit.adapters.voxels.opening_stored import placement_of_xarray
from topokit.core.arrays import Floats
from topokit.core.grid.placement import Placement
from topokit.errors import InputError, Option, ReadError, requiring
from topokit.inputs.files import head, require_beside
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import FREE_OF_MASKS, require_bytes, require_expansion

Volume = tuple[NDArray[Any], Placement | None]
_HOW = 'pip install "topokit[volumes]"'
_META, _DICOM = "MetaImageIO", "GDCMImageIO"  # named, since SimpleITK would try many others
_ONE_AT_A_TIME = threading.Lock()
_PAIR = b"ni1"  # the magic of a NIfTI header whose voxels are in a file of their own
_ELEMENT_BYTES = {"CHAR": 1, "UCHAR": 1, "SHORT": 2, "USHORT": 2, "INT": 4, "UINT": 4, "FLOAT": 4}  # others have 8


def read_nifti(path: Path) -> Volume:
    """Values scaled by slope and intercept; the affine is the sform, else the qform, else of pixdim."""
    with requiring(f"Reading .nii needs nibabel: {_HOW}."):
        import nibabel
        from nibabel.filebasedimages import ImageFileError
        from nibabel.spatialimages import HeaderDataError
        from nibabel.wrapstruct import WrapStructError
    data = path.read_bytes()
    kind = nibabel.Nifti2Image if data[4:7] == b"n+2" else nibabel.Nifti1Image
    with reading(path, "nibabel", ImageFileError, HeaderDataError, WrapStructError, LookupError):
        is_pair = data[344:347] == _PAIR or path.suffix.lower() == ".img"
        if is_pair:
            for one in nibabel.Nifti1Pair.filespec_to_file_map(path).values():
                require_beside(path, Path(one.filename))
        image = nibabel.Nifti1Pair.from_filename(path) if is_pair else kind.from_bytes(data)
        check_nibabel(path, image, _voxel_bytes(path, len(data)))
        return np.asanyarray(image.dataobj), _of_nibabel(image)


def read_mgh(path: Path) -> Volume:
    """A volume of FreeSurfer, with the affine of its header."""
    with requiring(f"Reading {path.suffix} needs nibabel: {_HOW}."):
        from nibabel.filebasedimages import ImageFileError
        from nibabel.freesurfer import MGHImage
        from nibabel.freesurfer.mghformat import MGHError
        from nibabel.spatialimages import HeaderDataError
        from nibabel.wrapstruct import WrapStructError
    data = path.read_bytes()
    with reading(path, "nibabel", ImageFileError, MGHError, HeaderDataError, WrapStructError, LookupError, TypeError):
        image = MGHImage.from_bytes(data)
        check_nibabel(path, image, len(data))
        return np.asanyarray(image.dataobj), _of_nibabel(image)


def _voxel_bytes(path: Path, size: int) -> int:
    """Bytes of a NIfTI file; with those of the image beside a header."""
    image = path.with_suffix(".img")
    return size + (image.stat().st_size if image.is_file() else 0)


def read_nrrd(path: Path) -> Volume:
    """Voxel sizes are the lengths of the space directions, else the spacings; the world needs a space origin, too."""
    with requiring(f"Reading .nrrd needs pynrrd: {_HOW}."):
        import nrrd
    with reading(path, "pynrrd", nrrd.NRRDError, LookupError, TypeError):
        own = path.resolve()  # pynrrd looks for voxels beside the name that it gets, be it a link
        check_nrrd(own)
        array, header = nrrd.read(str(own))
    return array, _of_nrrd(header)


def read_itk(path: Path) -> Volume:
    """A MetaImage, a DICOM file with several frames, or a folder with one DICOM series; in the order X, Y, Z."""
    with requiring(f"Reading {path.name} needs SimpleITK: {_HOW}."):
        import SimpleITK
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    is_meta = not path.is_dir() and not is_dicom(head(path))
    if is_meta:
        _check_metaimage(path)
    with _locale_kept(), reading(path, "SimpleITK", RuntimeError):
        if path.is_dir():
            return itk_array(SimpleITK.ReadImage(_series(path, SimpleITK), imageIO=_DICOM))
        _check_size(path, SimpleITK, _META if is_meta else _DICOM)
        return itk_array(SimpleITK.ReadImage(str(path), imageIO=_META if is_meta else _DICOM))


def itk_array(image: Any) -> Volume:
    """The voxels of a `SimpleITK.Image` in the order X, Y, Z, and where they are.

    Raises:
        ReadError: if they are vectors.
    """
    import SimpleITK

    if image.GetNumberOfComponentsPerPixel() > 1:
        raise ReadError(
            f"the image has {image.GetNumberOfComponentsPerPixel()} numbers in each voxel; one was expected. Take one "
            "with SimpleITK.VectorIndexSelectionCast."
        )
    values, spacing = SimpleITK.GetArrayFromImage(image).transpose(), np.asarray(image.GetSpacing())
    if len(spacing) != 3:
        return values, None
    directions = np.reshape(image.GetDirection(), (3, 3)) * spacing
    return values, Placement.of_affine(_affine(directions, image.GetOrigin()), "mm", "LPS")


def _of_nibabel(image: Any) -> Placement | None:
    """Where the voxels of an image of nibabel are; lengths without a unit are millimeters, as everywhere."""
    units = getattr(getattr(image, "header", None), "get_xyzt_units", None)  # MGH images have none
    unit = {"meter": "m", "micron": "µm"}.get("" if units is None else units()[0], "mm")
    return Placement.of_affine(np.asarray(image.affine, dtype=float), unit, "RAS")


def _of_nrrd(header: Any) -> Placement | None:
    """Where the voxels are by the header of a NRRD file, whose space directions have a row for each axis."""
    units, named = header.get("space units", ()), str(header.get("space", ""))
    unit = units[0] if len(set(units)) == 1 else "mm" if "anterior" in named or "posterior" in named else ""
    if "space directions" not in header:
        return Placement(_triple(header["spacings"])) if "spacings" in header else None
    directions = np.asarray(header["space directions"], dtype=float).T
    if "space origin" not in header:
        return Placement(_triple(np.linalg.norm(directions, axis=0)), unit=unit)
    space = "".join(word[0].upper() for word in named.split("-")) if "-" in named else named
    return Placement.of_affine(_affine(directions, header["space origin"]), unit, space)


def _affine(directions: Floats, origin: Any) -> Floats:
    """The 4 × 4 matrix that takes an index to a position."""
    affine: Floats = np.eye(4)
    affine[:3, :3], affine[:3, 3] = directions, origin
    return affine


def image_of(source: Any, entry: Entry) -> tuple[Any, Placement | None, tuple[str, ...]] | None:
    """The voxels of an object that holds an image, and where they are.

    Args:
        source: an image of nibabel, a `SimpleITK.Image`, an `xarray.DataArray`, or a `MetaTensor` of MONAI, with or
            without its channel.
        entry: which part of it is the volume.

    Returns:
        Voxels (X, Y, Z) as an array or tensor, with a channel if one is to be chosen; where they are or None; and the
        names of the axes, if they have some. None for other objects.

    Raises:
        InputError: if it has several channels, or coordinates of xarray that are not evenly spaced.
    """
    affine = getattr(source, "affine", None)
    if hasattr(source, "dataobj") and affine is not None:
        return np.asanyarray(source.dataobj), _of_nibabel(source), ()
    if isinstance(source, Tensor) and isinstance(affine, Tensor):
        plain = source.as_tensor() if hasattr(source, "as_tensor") else source
        matrix = affine.detach().cpu().double().numpy()
        placement = Placement.of_affine(matrix, "mm", str(getattr(source, "meta", {}).get("space", "RAS")))
        return (plain, placement, tuple("cxyz")) if entry.channel is not None else (_only_channel(plain), placement, ())
    if hasattr(source, "dims") and hasattr(source, "coords") and hasattr(source, "values"):
        return np.asarray(source.values), placement_of_xarray(source, entry), tuple(map(str, source.dims))
    if hasattr(source, "GetSpacing") and hasattr(source, "GetNumberOfComponentsPerPixel"):
        return *itk_array(source), ()
    return None


def _only_channel(values: Tensor) -> Tensor:
    """(X, Y, Z) of (1, X, Y, Z)."""
    if values.ndim != 4:
        return values
    if len(values) != 1:
        raise InputError(f"the image has {len(values)} channels: pass ", Option("channel", "0"), ".")
    return values[0]


@contextmanager
def _locale_kept() -> Iterator[None]:
    """The locale as it was: GDCM sets it to "C" for good, and then Python reads text files as ASCII."""
    with _ONE_AT_A_TIME:  # the locale is that of the process
        before = locale.setlocale(locale.LC_ALL)
        try:
            yield
        finally:
            locale.setlocale(locale.LC_ALL, before)


def _series(folder: Path, itk: Any) -> tuple[str, ...]:
    """The files of the only DICOM series in a folder, in the order of their slices."""
    for one in sorted(folder.iterdir()):
        if one.is_symlink() and not one.resolve().is_relative_to(folder.resolve()):
            raise ReadError(f"{folder} holds the link {one.name!r} to a file elsewhere: it is not opened.")
    names = itk.ImageSeriesReader.GetGDCMSeriesIDs(str(folder))
    if len(names) != 1:
        held = f"{len(names)} DICOM series; put each into a folder of its own" if names else "no DICOM series"
        raise ReadError(f"{folder} holds {held}.")
    files: tuple[str, ...] = itk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder), names[0])
    if len(files) == 1:
        _check_size(Path(files[0]), itk, _DICOM)
    return files


def _check_size(path: Path, itk: Any, io_name: str) -> None:
    """Refuse a single slice, and a header that announces absurd sizes."""
    reader = itk.ImageFileReader()
    reader.SetImageIO(io_name)
    reader.SetFileName(str(path))
    reader.ReadImageInformation()
    size = reader.GetSize()
    require_expansion(path, math.prod(size) * reader.GetNumberOfComponents(), path.stat().st_size)
    if len(size) < 3 or size[2] == 1:
        raise ReadError(f"{path} is one slice of {size[0]} × {size[1]} pixels: give the folder with its series.")


def _check_metaimage(path: Path) -> None:
    """Refuse a header that announces more than there is, or that names a file elsewhere."""
    fields = _metaimage_fields(head(path))
    if not {b"DimSize", b"ElementDataFile"} <= fields.keys():
        raise ReadError(
            f"{path} has no complete MetaImage header: lines of the form NAME = VALUE, DimSize among them and "
            "ElementDataFile the last, are needed."
        )
    name = fields[b"ElementDataFile"].decode("utf-8", "replace")
    data = path
    if name.upper() != "LOCAL":
        if re.search(r'[/\\:*?"<>|%\s]', name) or name.upper() == "LIST" or name.startswith("."):
            raise ReadError(f"{path} keeps its voxels in {name!r}; the plain name of one file beside it was expected.")
        data = require_beside(path, path.with_name(name))
    with reading(path, "the MetaImage reader"):
        n_voxels = math.prod(max(0, int(word)) for word in fields[b"DimSize"].split())
        n_channels = int(fields.get(b"ElementNumberOfChannels", b"1"))
    kind = fields.get(b"ElementType", b"").decode("ascii", "replace").upper().removeprefix("MET_")
    needed = n_voxels * n_channels * _ELEMENT_BYTES.get(kind, 8)
    if fields.get(b"CompressedData", b"").upper() == b"TRUE":
        require_expansion(path, needed, data.stat().st_size, FREE_OF_MASKS)
    else:
        require_bytes(path, f"{n_voxels} voxels", needed, data.stat().st_size)


def _metaimage_fields(header: bytes) -> dict[bytes, bytes]:
    """What the lines of a header say, up to the one with the place of the voxels, or to one that is malformed.

    SimpleITK takes a colon for the equals sign and sees names where we see none: a second place of voxels, for example.
    """
    fields: dict[bytes, bytes] = {}
    for line in filter(bytes.strip, header.split(b"\n")):
        found = re.fullmatch(rb"[ \t]*(\w+)[ \t]*=([^\r]*)\r*", line)
        if found is None:
            break
        fields[found.group(1)] = found.group(2).strip()
        if found.group(1) == b"ElementDataFile":
            break
    return fields


def _triple(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
