"""Reading volumes: one short function per format, each giving an array (X, Y, Z) and its spacing or None."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.voxels.bounds import FREE, check_nifti, check_nrrd, check_tiff
from topokit.adapters.voxels.entry import NRRD, TIFF, VOXELS, is_nifti
from topokit.core.grid.grid import Spacing
from topokit.errors import MissingDependencyError, ReadError
from topokit.inputs.files import GZIP, ZIP, head, unpacked_head
from topokit.inputs.numpy_header import NUMPY, array_shapes
from topokit.inputs.reading import reading, require_expansion

Volume = tuple[NDArray[Any], Spacing | None]
_STEP = 1 << 20  # bytes unpacked at a time
_HOW = 'pip install "topokit[volumes]"'


def read_volume(path: Path) -> Volume:
    """Array and spacing of a file, by content; the axes are in the order in which the format's reader gives them.

    Raises:
        ReadError: if the file is malformed or holds no 3-D array.
        MissingDependencyError: if the format's reader is not installed.
    """
    reader = _reader(path)
    with reading(path, f"the {reader.__name__.removeprefix('_read_')} reader", extra="topokit[volumes]"):
        array, spacing = reader(path)
    if array.ndim != 3:
        raise ReadError(f"{path} holds an array of shape {array.shape}; a volume (X, Y, Z) was expected.")
    return array, spacing


def _reader(path: Path) -> Callable[[Path], Volume]:
    beginning = unpacked_head(path)
    for looks_like, reader in _BY_CONTENT:
        if looks_like(beginning):
            return reader
    raise ReadError(f"{path} is not a volume by its content. Known: {', '.join(VOXELS.suffixes)}.")


def _read_npy(path: Path) -> Volume:
    array_shapes(path)  # refuses a header that does not fit the file
    return np.load(path, allow_pickle=False), None


def _read_npz(path: Path) -> Volume:
    shapes = array_shapes(path)
    with np.load(path, allow_pickle=False) as archive:
        volumes = [name for name in archive.files if len(shapes.get(name.lower(), ())) == 3]
        if len(volumes) != 1:
            held = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
            raise ReadError(f"{path} holds {held}; exactly one array with three axes was expected.")
        spacing = np.ravel(archive["spacing"]).astype(float) if "spacing" in archive.files else None
        if spacing is not None and len(spacing) not in (1, 3):
            raise ReadError(f"{path}: 'spacing' holds {len(spacing)} numbers; 1 or 3 were expected.")
        return archive[volumes[0]], None if spacing is None else _triple(np.broadcast_to(spacing, 3))


def _read_nifti(path: Path) -> Volume:
    try:
        import nibabel
        from nibabel.filebasedimages import ImageFileError
        from nibabel.spatialimages import HeaderDataError
        from nibabel.wrapstruct import WrapStructError
    except ImportError as error:
        raise MissingDependencyError(f"Reading .nii needs nibabel: {_HOW}.") from error
    data = _bytes(path)
    kind = nibabel.Nifti2Image if data[4:7] == b"n+2" else nibabel.Nifti1Image
    with reading(path, "nibabel", ImageFileError, HeaderDataError, WrapStructError):
        image = kind.from_bytes(data)
        check_nifti(path, image, len(data))
        array = np.asanyarray(image.dataobj)
    if array.ndim == 4 and array.shape[3] == 1:
        array = array[..., 0]
    return array, _triple(image.header.get_zooms()[:3])


def _bytes(path: Path) -> bytes:
    if head(path).startswith(GZIP):
        return _unzipped(path)
    return path.read_bytes()


def _unzipped(path: Path) -> bytes:
    """What a gzip file holds, unless it is absurdly much."""
    content, size = bytearray(), path.stat().st_size
    with gzip.open(path) as file:
        while part := file.read(_STEP):
            content += part
            require_expansion(path, len(content), size, FREE)
    return bytes(content)


def _read_nrrd(path: Path) -> Volume:
    try:
        import nrrd
    except ImportError as error:
        raise MissingDependencyError(f"Reading .nrrd needs pynrrd: {_HOW}.") from error
    with reading(path, "pynrrd", nrrd.NRRDError, LookupError, TypeError):
        check_nrrd(path)
        array, header = nrrd.read(str(path))
    if "space directions" in header:
        return array, _triple(np.linalg.norm(np.asarray(header["space directions"], dtype=float), axis=1))
    return array, _triple(header["spacings"]) if "spacings" in header else None


def _read_tiff(path: Path) -> Volume:
    try:
        import tifffile
    except ImportError as error:
        raise MissingDependencyError(f"Reading .tif needs tifffile: {_HOW}.") from error
    damaged = (
        tifffile.TiffFileError,
        ArithmeticError,
        AssertionError,
        LookupError,
        RuntimeError,
        TypeError,
    )
    with reading(path, "tifffile", *damaged), tifffile.TiffFile(path, _multifile=False) as file:
        check_tiff(path, file)
        return file.asarray(), None


def _triple(values: Any) -> Spacing:
    x, y, z = (float(value) for value in values)
    return x, y, z


_BY_CONTENT: tuple[tuple[Callable[[bytes], bool], Callable[[Path], Volume]], ...] = (
    (lambda start: start.startswith(NUMPY), _read_npy),
    (lambda start: start.startswith(ZIP), _read_npz),
    (is_nifti, _read_nifti),
    (lambda start: start.startswith(NRRD), _read_nrrd),
    (lambda start: start.startswith(TIFF), _read_tiff),
)
