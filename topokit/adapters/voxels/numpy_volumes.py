"""Volumes in .npy and .npz files: read as a whole, or as a memory map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from topokit.adapters.voxels.chosen_part import Entry, volume_axes
from topokit.adapters.voxels.files import Volume
from topokit.adapters.voxels.stored_volumes import MappedVolume, StoredVolume
from topokit.core.grid.placement import Placement
from topokit.errors import ReadError
from topokit.inputs.headers import array_shapes
from topokit.inputs.reading import reading


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


def npy_volume(path: Path, entry: Entry) -> StoredVolume | None:
    """An array of three axes as a memory map; there is no data set to choose."""
    shape = array_shapes(path).get("", ())
    if len(volume_axes(shape, entry.chosen(shape, ()))) != 3:
        return None
    with reading(path, "the NumPy reader"):
        return MappedVolume(np.load(path, mmap_mode="r", allow_pickle=False), path.name, entry)
