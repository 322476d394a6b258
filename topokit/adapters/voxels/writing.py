"""Writing volumes: values, voxel sizes and the place in the world, in the formats that can hold them."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Floats
from topokit.core.grid.placement import Placement
from topokit.errors import InputError, MissingDependencyError

Values = NDArray[Any]

_HOW = 'pip install "topokit[volumes]"'
_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])  # from RAS, and back
_ITK_TYPES = "bBhHiIfd"
_IMAGEJ_TYPES = "BHf"


def write_volume(path: Path, suffix: str, values: Values, placement: Placement) -> None:
    """Write a volume.

    Args:
        path: file to write.
        suffix: that of the format, one of `WRITERS`.
        values: (X, Y, Z); booleans become 0 and 1 of 8 bits but in NumPy's formats.
        placement: where the voxels are.

    Raises:
        InputError: if the format has no such type of values.
        MissingDependencyError: if the format's writer is not installed.
    """
    try:
        WRITERS[suffix](path, values, placement)
    except ImportError as error:
        raise MissingDependencyError(f"Writing {suffix} needs {error.name}: {_HOW}.") from error


def _write_npy(path: Path, values: Values, placement: Placement) -> None:
    with path.open("wb") as stream:
        np.save(stream, values)


def _write_npz(path: Path, values: Values, placement: Placement) -> None:
    with path.open("wb") as stream:
        np.savez_compressed(stream, volume=values, spacing=np.asarray(placement.spacing))


def _write_nifti(path: Path, values: Values, placement: Placement) -> None:
    path.write_bytes(_nifti(values, placement))


def _write_gzipped_nifti(path: Path, values: Values, placement: Placement) -> None:
    path.write_bytes(gzip.compress(_nifti(values, placement), compresslevel=6, mtime=0))


def _nifti(values: Values, placement: Placement) -> bytes:
    import nibabel

    values = _numbers(values)
    image = nibabel.Nifti1Image(values, _affine(placement, "RAS"), dtype=values.dtype)
    image.header.set_xyzt_units({"m": "meter", "µm": "micron"}.get(placement.unit, "mm"))
    return bytes(image.to_bytes())


def _write_nrrd(path: Path, values: Values, placement: Placement) -> None:
    import nrrd

    affine = _affine(placement, placement.space)
    header: dict[str, Any] = {"space directions": affine[:3, :3].T, "space origin": affine[:3, 3]}
    header |= {"space": placement.space} if placement.space else {"space dimension": 3}
    if placement.unit:
        header["space units"] = [placement.unit] * 3
    nrrd.write(str(path), _numbers(values), header)


def _write_metaimage(path: Path, values: Values, placement: Placement) -> None:
    import SimpleITK

    values = _checked(_numbers(values), _ITK_TYPES, ".mha")
    affine = _affine(placement, "LPS")
    steps = np.linalg.norm(affine[:3, :3], axis=0)
    image = SimpleITK.GetImageFromArray(values.transpose())
    image.SetSpacing(steps.tolist())
    image.SetOrigin(affine[:3, 3].tolist())
    image.SetDirection((affine[:3, :3] / steps).ravel().tolist())
    SimpleITK.WriteImage(image, str(path), useCompression=True)


def _write_tiff(path: Path, values: Values, placement: Placement) -> None:
    import tifffile

    z, y, x = placement.spacing
    about = {"axes": "ZYX", "spacing": z, "unit": placement.unit}
    stack = _checked(_numbers(values), _IMAGEJ_TYPES, ".tif")
    tifffile.imwrite(path, stack, imagej=True, resolution=(1 / x, 1 / y), metadata=about)


def _numbers(values: Values) -> Values:
    return values.astype(np.uint8) if values.dtype == bool else values


def _checked(values: Values, types: str, suffix: str) -> Values:
    if values.dtype.char not in types:
        known = ", ".join(str(np.dtype(one)) for one in types)
        raise InputError(f"{suffix} holds {known}; the volume is {values.dtype}. Convert it, or write .npy or .nii.")
    return values


def _affine(placement: Placement, space: str) -> Floats:
    """The 4 × 4 matrix from indices to world coordinates, turned from RAS to LPS or back where that is asked for."""
    if placement.affine is None:
        return np.diag([*placement.spacing, 1.0])
    affine: Floats = np.asarray(placement.affine)
    return _LPS @ affine if {placement.space, space} == {"RAS", "LPS"} else affine


WRITERS: dict[str, Callable[[Path, Values, Placement], None]] = {
    ".npy": _write_npy,
    ".npz": _write_npz,
    ".nii": _write_nifti,
    ".nii.gz": _write_gzipped_nifti,
    ".nrrd": _write_nrrd,
    ".mha": _write_metaimage,
    ".tif": _write_tiff,
    ".tiff": _write_tiff,
}
"""What writes a volume, by the end of the file's name."""
