"""Zarr volumes of any size, in folders and at addresses: OME-Zarr's levels, and sizes held against what is stored.

They are read box by box as any of `stored_volumes`; `larger_than_memory` counts those that do not fit there.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Sequence
from math import prod
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from topokit.adapters.voxels.announced_sizes import check_chunks
from topokit.adapters.voxels.chosen_part import Entry, axis_names, chosen_array
from topokit.adapters.voxels.stored_volumes import IndexedVolume, StoredVolume
from topokit.core.arrays import Floats
from topokit.core.grid.placement import Placement
from topokit.errors import ReadError, requiring
from topokit.inputs.reading import reading
from topokit.inputs.remote import asking
from topokit.inputs.size_limits import most_expanded

_OF_ZARR = (".json", ".zarray", ".zattrs", ".zgroup", ".zmetadata")  # ends of names of files that hold no values
_INDEX_BYTES = 16  # of a chunk in the index of a shard
_UNITS = {"meter": "m", "millimeter": "mm", "micrometer": "µm", "nanometer": "nm", "angstrom": "Å"}  # of OME-Zarr


def zarr_volume(path: Path | str, entry: Entry) -> StoredVolume:
    """The volume in a folder or at an address."""
    name = PurePosixPath(path).name
    with requiring('Reading .zarr needs zarr: pip install "topokit[cluster]".'):
        import zarr
        from zarr.errors import BaseZarrError
    placement: Placement | None = None
    names: tuple[str, ...] = ()
    with asking(path) if isinstance(path, str) else reading(path, "zarr", BaseZarrError, LookupError, TypeError):
        if isinstance(path, Path):
            refuse_links(path)
        found: Any = zarr.open(path, mode="r")
        if isinstance(found, zarr.Group):
            arrays = {
                name: part for name, part in sorted(found.members(max_depth=None)) if isinstance(part, zarr.Array)
            }
            shapes = {name: one.shape for name, one in arrays.items()}
            names, levels = _levels(found)
            chosen = chosen_array(path, shapes, entry._replace(dataset=entry.dataset or next(iter(levels), None)))
            names = names if chosen in levels else ()
            found, placement = arrays[chosen], levels.get(chosen)
        if isinstance(path, str):
            check_remote_zarr(path, found)
        else:
            check_zarr(path, found)
    return IndexedVolume(found, name, placement, entry, names or axis_names(found))


def _levels(group: Any) -> tuple[tuple[str, ...], dict[str, Placement | None]]:
    """The names of the axes of an OME-Zarr image, and its levels, finest first: paths, and where their voxels are.

    Of other groups there are none.

    Reference:
        J. Moore et al., "OME-Zarr: a cloud-optimized bioimaging file format with international community support",
        2023, doi:10.1007/s00418-023-02209-1.
    """
    attributes = dict(group.attrs)
    images = attributes.get("ome", attributes).get("multiscales") or [{}]
    axes = [axis if isinstance(axis, dict) else {} for axis in images[0].get("axes", ())]
    spatial = [number for number, axis in enumerate(axes) if axis.get("type", "space") == "space"]
    units = [axes[number].get("unit", "") for number in spatial]
    found: dict[str, Placement | None] = {}
    for level in images[0].get("datasets", ()):
        given = {one.get("type"): one for one in level.get("coordinateTransformations", ())}
        scale, first = (np.asarray(given.get(name, {}).get(name, ()), dtype=float) for name in ("scale", "translation"))
        if len(scale) == len(axes):
            scale, first = scale[spatial], first[spatial] if len(first) == len(axes) else first
        found[level["path"]] = _ome_placement(scale, first, units)
    return tuple(str(axis.get("name", "")) for axis in axes), found


def _ome_placement(scale: Floats, first: Floats, units: Sequence[str]) -> Placement | None:
    """Where voxels are by their sizes, the center of the first one and the units; None unless there are three axes."""
    if len(scale) != 3:
        return None
    unit = _UNITS.get(units[-1], units[-1]) if len(set(units)) == 1 else ""
    if len(first) != 3:
        return Placement(tuple(scale.tolist()), unit=unit)
    affine = np.diag([*scale, 1.0])
    affine[:3, 3] = first
    return Placement.of_affine(affine, unit)


def check_zarr(folder: Path, array: Any) -> None:
    """Refuse a `zarr.Array` in a folder that announces far more than is stored; files are counted as far as needed.

    Raises:
        ReadError: if it does.
    """
    itemsize = np.dtype(array.dtype).itemsize
    chunk = prod(array.chunks) * itemsize
    shard = prod(array.shards or array.chunks) * itemsize
    announced, place, n_files, packed, stored = prod(map(int, array.shape)) * itemsize, folder / array.path, 0, 0, 0
    for file in _files(place):
        if announced <= most_expanded(stored) and chunk <= most_expanded(packed):
            break
        n_files, packed = n_files + 1, packed + file.stat().st_size
        stored = n_files * shard if array.shards is None else min(n_files * shard, packed // _INDEX_BYTES * chunk)
    check_chunks(place, announced, chunk, stored, packed)


def check_remote_zarr(address: str, array: Any) -> None:
    """Refuse a `zarr.Array` at an address, where files cannot be counted, with chunks that exhaust memory.

    Raises:
        ReadError: if it has such chunks.
    """
    check_chunks(address, 0, prod(array.chunks) * np.dtype(array.dtype).itemsize, 0, 0)


def refuse_links(folder: Path) -> None:
    """Refuse a folder of zarr with links, which lead elsewhere or in circles.

    Raises:
        ReadError: if there is one, anywhere below it.
    """
    deque(_files(folder), maxlen=0)


def _files(folder: Path) -> Iterator[os.DirEntry[str]]:
    """The files in a folder and below it, but those of metadata."""
    waiting = [str(folder)]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in entries:
                if entry.is_symlink():
                    raise ReadError(f"{folder} holds the link {entry.name!r}: only what lies in the folder is opened.")
                if entry.is_dir():
                    waiting.append(entry.path)
                elif not entry.name.endswith(_OF_ZARR):
                    yield entry
