"""How much of an array is stored, held against what its header announces; and that all of it lies in the given file."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from topokit.adapters.voxels.bounds import check_chunks
from topokit.errors import ReadError
from topokit.inputs.reading import most_expanded, require_bytes

_OF_ZARR = (".json", ".zarray", ".zattrs", ".zgroup", ".zmetadata")  # ends of names of files that hold no values
_INDEX_BYTES = 16  # of a chunk in the index of a shard


def check_hdf(path: Path, dataset: Any) -> None:
    """Refuse an `h5py.Dataset` whose values are in other files, or that announces far more than is stored.

    Raises:
        ReadError: if it is one.
    """
    others = [name for name, *_ in dataset.external or ()]
    if dataset.is_virtual:
        others = [source.file_name for source in dataset.virtual_sources()]
    if others or dataset.is_virtual:
        names = ", ".join(map(repr, sorted(set(others)))) or "other data sets"
        raise ReadError(f"{path} keeps the values of {dataset.name} in {names}; only the given file is opened.")
    packed = dataset.id.get_storage_size()
    require_bytes(path, f"the values of {dataset.name}", packed, path.stat().st_size)
    if dataset.chunks is None:
        check_chunks(path, dataset.nbytes, 0, packed, packed)
    else:
        chunk = prod(dataset.chunks) * dataset.dtype.itemsize
        check_chunks(path, _n_bytes(dataset), chunk, dataset.id.get_num_chunks() * chunk, packed)


def check_zarr(folder: Path, array: Any) -> None:
    """Refuse a `zarr.Array` in a folder that announces far more than is stored; files are counted as far as needed.

    Raises:
        ReadError: if it does.
    """
    itemsize = np.dtype(array.dtype).itemsize
    chunk = prod(array.chunks) * itemsize
    shard = prod(array.shards or array.chunks) * itemsize
    announced, place, n_files, packed, stored = _n_bytes(array), folder / array.path, 0, 0, 0
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


def _n_bytes(array: Any) -> int:
    return prod(map(int, array.shape)) * np.dtype(array.dtype).itemsize
