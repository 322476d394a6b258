"""Reading volumes: the reader of each format, chosen by content; each gives an array (X, Y, Z) and its spacing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.voxels.entry import NRRD, TIFF, VOXELS, is_dicom, is_metaimage, is_nifti
from topokit.adapters.voxels.medical import read_itk, read_nifti, read_nrrd
from topokit.adapters.voxels.tiff import read_tiff
from topokit.core.grid.grid import Spacing
from topokit.errors import ReadError
from topokit.inputs.files import ZIP, head
from topokit.inputs.numpy_header import NUMPY, array_shapes
from topokit.inputs.reading import reading

Volume = tuple[NDArray[Any], Spacing | None]


def read_volume(path: Path) -> Volume:
    """Array and spacing of a file or of a folder with a DICOM series, by content.

    The axes are in the order in which the format's reader gives them, and so is the spacing. It is None if the file
    does not tell it.

    Raises:
        ReadError: if the file is malformed or holds no 3-D array.
        MissingDependencyError: if the format's reader is not installed.
    """
    name, reader = _reader(path)
    with reading(path, f"the {name} reader", extra="topokit[volumes]"):
        array, spacing = reader(path)
    if array.ndim != 3:
        raise ReadError(
            f"{path} holds an array of shape {array.shape}; a volume (X, Y, Z) was expected. Of several channels or "
            "times read the file yourself and pass one of them: topokit.from_voxels(array, spacing=...)."
        )
    return array, spacing


def _reader(path: Path) -> tuple[str, Callable[[Path], Volume]]:
    beginning = head(path)
    for name, looks_like, reader in _BY_CONTENT:
        if looks_like(beginning):
            return name, reader
    if path.is_dir():
        return "DICOM", read_itk
    if path.suffix.lower() == ".img" and is_nifti(head(_header_of(path))):
        return "NIfTI", read_nifti
    raise ReadError(f"{path} is not a volume by its content. Known: {', '.join(VOXELS.suffixes)}.")


def _header_of(image: Path) -> Path:
    """The .hdr that describes an .img; the image itself if there is none."""
    header = image.with_suffix(".hdr")
    return header if header.is_file() else image


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
        if spacing is None:
            return archive[volumes[0]], None
        x, y, z = np.broadcast_to(spacing, 3).tolist()
        return archive[volumes[0]], (x, y, z)


_BY_CONTENT: tuple[tuple[str, Callable[[bytes], bool], Callable[[Path], Volume]], ...] = (
    ("NPY", lambda start: start.startswith(NUMPY), _read_npy),
    ("NPZ", lambda start: start.startswith(ZIP), _read_npz),
    ("NIfTI", is_nifti, read_nifti),
    ("NRRD", lambda start: start.startswith(NRRD), read_nrrd),
    ("TIFF", lambda start: start.startswith(TIFF), read_tiff),
    ("DICOM", is_dicom, read_itk),
    ("MetaImage", is_metaimage, read_itk),
)
