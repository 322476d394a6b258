"""A copy of a stored volume that can be written to box by box: .npy as a memory map, or zarr."""

from __future__ import annotations

import os
import shutil
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.voxels.stored_volumes import StoredVolume
from topokit.core.blocks.division import Box, Division
from topokit.ending import finally_do
from topokit.errors import InputError, requiring
from topokit.inputs.writing import completed_file

SUFFIXES = (".npy", ".zarr")
"""Of files that are written box by box."""

_CHUNK = 128  # voxels along an axis that are written together

Values = NDArray[Any]


class StoredCopy(ABC):
    """A volume that is read and written box by box, in a file or folder with a path."""

    path: Path

    def read(self, box: Box) -> Values:
        """The values in a box."""
        return np.array(self._array()[_slices(box)])

    def write(self, box: Box, values: Values) -> None:
        """Change the values in a box."""
        self._array()[_slices(box)] = values

    @abstractmethod
    def _array(self) -> Any:
        """What is indexed with slices; made anew for each use, so that no pages of a file stay in memory."""


class _MappedCopy(StoredCopy):
    def __init__(self, path: Path, volume: StoredVolume) -> None:
        self.path = path
        np.lib.format.open_memmap(path, "w+", volume.dtype, volume.shape)

    def _array(self) -> Any:
        return np.load(self.path, mmap_mode="r+", allow_pickle=False)


class _ZarrCopy(StoredCopy):
    def __init__(self, path: Path, volume: StoredVolume) -> None:
        with requiring('Writing .zarr needs zarr: pip install "topokit[cluster]".'):
            import zarr
        self.path = path
        chunks = tuple(min(n, _CHUNK) for n in volume.shape)
        self._found = zarr.create_array(store=path, shape=volume.shape, chunks=chunks, dtype=volume.dtype)

    def _array(self) -> Any:
        return self._found


@contextmanager
def stored_copy(path: str | os.PathLike[str], volume: StoredVolume) -> Iterator[StoredCopy]:
    """A copy of a volume under another name beside a file, which it becomes when the block is left without an error.

    Args:
        path: file to write, .npy, or folder, .zarr, which must not exist.
        volume: what is copied.

    Raises:
        InputError: if the path is called otherwise, its folder is missing, or it is a folder that exists.
        MissingDependencyError: if zarr is not installed.
    """
    target = Path(path)
    if target.suffix not in SUFFIXES:
        raise InputError(f"a volume in blocks is written as {' or '.join(SUFFIXES)}; {target.name!r} is neither.")
    if not target.parent.is_dir():
        raise InputError(f"{target}: the folder {target.parent} does not exist.")
    if target.suffix == ".npy":
        with completed_file(target) as unfinished:
            yield _filled(_MappedCopy(unfinished, volume), volume)
        return
    if target.exists():
        raise InputError(f"{target} exists: remove it, or write another one.")
    folder = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.stem}-", suffix=".part"))
    with finally_do(partial(shutil.rmtree, folder, ignore_errors=True)):
        yield _filled(_ZarrCopy(folder / target.name, volume), volume)
        os.replace(folder / target.name, target)


def _filled(copy: StoredCopy, volume: StoredVolume) -> StoredCopy:
    chunks = [[*[_CHUNK] * (n // _CHUNK), *[n % _CHUNK] * (n % _CHUNK > 0)] for n in volume.shape]
    for box in Division.of(chunks).boxes:
        copy.write(box, volume.read(box))
    return copy


def _slices(box: Box) -> tuple[slice, ...]:
    return tuple(slice(*side) for side in box)
