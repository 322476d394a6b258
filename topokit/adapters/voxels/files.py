"""Reading volumes: the reader of each format, chosen by content; each gives an array (X, Y, Z) and its placement."""

from __future__ import annotations

import pkgutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.voxels.entry import FORMATS, VOXELS
from topokit.adapters.voxels.stored import ALL, Entry, volume_axes, volume_index
from topokit.core.grid.placement import Placement
from topokit.errors import ReadError
from topokit.inputs.files import head
from topokit.inputs.formats import format_of
from topokit.inputs.headers import array_shapes
from topokit.inputs.reading import reading

Volume = tuple[NDArray[Any], Placement | None]


def read_volume(path: Path, entry: Entry = ALL) -> Volume:
    """The array of a file or of a folder with a DICOM series, by content, and where its voxels are.

    Args:
        path: of it.
        entry: which part is the volume.

    The axes are in the order in which the format's reader gives them. The placement is None if the file has none.

    Raises:
        ReadError: if the file is malformed or holds no 3-D array.
        MissingDependencyError: if the format's reader is not installed.
    """
    found = format_of(FORMATS, path, head(path))
    if found is None or found.read is None:
        raise ReadError(f"{path} is not a volume by its content. Known: {', '.join(VOXELS.suffixes)}.")
    with reading(path, f"the {found.name} reader", extra="topokit[volumes]"):
        array, placement = pkgutil.resolve_name(found.read)(path)
    chosen = entry.chosen(array.shape, ())
    if array.ndim != 3 and len(volume_axes(array.shape, chosen)) != 3:
        one = "Of one slice give the folder with all slices, or pass topokit.from_voxels(array[None])."
        several = "Of several channels or times pass axis= and channel=, the number of an axis and of one along it."
        hint = one if array.ndim == 2 else several
        raise ReadError(f"{path} holds an array of shape {array.shape}; a volume (X, Y, Z) was expected. {hint}")
    return array[volume_index(array.shape, entry)] if chosen else array, placement


def read_npy(path: Path) -> Volume:
    """An array in memory."""
    array_shapes(path)  # refuses a header that does not fit the file
    return np.load(path, allow_pickle=False), None


def read_npz(path: Path) -> Volume:
    """The only array of three axes, and what is stored beside it as "spacing"."""
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
        return archive[volumes[0]], Placement((x, y, z))
