"""Volumes that stay where they are stored, and are read box by box: zarr, HDF5, memory maps, Dask arrays, and the like.

All of these can be sent to other processes, which then read for themselves. A Dask array around each of them would not
do: it goes through the graph of all chunks for every box, which takes 0.3 s for 2048³ voxels in chunks of 64³ and 1.6 s
for 8192³, instead of milliseconds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from topokit.adapters.voxels.chosen_part import ALL, Entry, volume_index
from topokit.core.blocks.division import Box
from topokit.core.blocks.part import Periodic
from topokit.core.grid.placement import Placement
from topokit.errors import InputError
from topokit.inputs.reading import reading

Values = NDArray[Any]
Lengths = tuple[tuple[int, ...], ...]
_MOST_CHUNKS = 1 << 20  # along an axis; beyond, neighbors count as one chunk, as their lengths take memory


class StoredVolume(ABC):
    """A volume that is read box by box.

    Attributes:
        name: what to call it.
        shape: voxels along each axis.
        dtype: of its values.
        chunks: for each axis, the lengths of the chunks in which it is stored: what is read together anyway.
        placement: where its voxels are, if the file says it.
    """

    placement: Placement | None = None

    def __init__(
        self,
        name: str,
        shape: Sequence[int],
        dtype: DTypeLike,
        chunks: Sequence[int] | Lengths,
        entry: Entry = ALL,
        names: Sequence[str] = (),
    ) -> None:
        """Args: see the class and `volume_index`; chunks may be one length for each axis.

        Raises:
            InputError: if this is no volume of real numbers.
        """
        self._index = volume_index(shape, entry, names)
        axes = [axis for axis, one in enumerate(self._index) if isinstance(one, slice)]
        x, y, z = (int(shape[axis]) for axis in axes)
        chunks = tuple(chunks[axis] for axis in axes)  # type: ignore[assignment]
        self.name, self.shape, self.dtype = name, (x, y, z), np.dtype(dtype)
        if self.dtype.kind not in "biuf":
            raise InputError(f"the volume must hold real numbers, got {self.dtype}.")
        self.chunks = tuple(_lengths(chunks[axis], n) for axis, n in enumerate(self.shape))

    def _slices(self, box: Box) -> tuple[slice | int, ...]:
        """How the array that holds the volume is indexed to get a box."""
        sides = iter(box)
        return tuple(slice(*next(sides)) if isinstance(one, slice) else one for one in self._index)

    @property
    def n_voxels(self) -> int:
        """Voxels in all."""
        return prod(self.shape)

    def at(self, box: Box) -> Any:
        """What a worker gets in order to read a box: called, it gives the values."""
        return _Reading(self, box)

    def whole(self) -> Values:
        """All values."""
        x, y, z = self.shape
        return self.read(((0, x), (0, y), (0, z)))

    @abstractmethod
    def read(self, box: Box) -> Values:
        """The values in a box, given by its first and last + 1 voxel along each axis."""


class _Reading:
    """The reading of a box, still to be done."""

    def __init__(self, volume: StoredVolume, box: Box) -> None:
        self._volume, self._box = volume, box

    def __call__(self) -> Values:
        return self._volume.read(self._box)


class IndexedVolume(StoredVolume):
    """An array that gives the values of a box when it is indexed with slices, such as one of zarr or TensorStore."""

    def __init__(
        self,
        array: Any,
        name: str = "voxels",
        placement: Placement | None = None,
        entry: Entry = ALL,
        names: Sequence[str] = (),
    ) -> None:
        """Args: the array, what to call it, where its voxels are, if known; for the others see `volume_index`."""
        super().__init__(name, array.shape, _numpy_type(array), _chunks_of(array), entry, names)
        self.placement = placement
        self._array, self._library = array, type(array).__module__.partition(".")[0]

    def read(self, box: Box) -> Values:
        """See `StoredVolume`."""
        with reading(self.name, f"the library {self._library!r}", RuntimeError, MemoryError):
            return np.asarray(self._array[self._slices(box)])


class MemoryVolume(IndexedVolume):
    """An array in memory: a worker gets the values of a box themselves."""

    def at(self, box: Box) -> Any:
        """See `StoredVolume`."""
        return self.read(box)


class DaskVolume(IndexedVolume):
    """A Dask array: its blocks are computed where they are counted."""

    def at(self, box: Box) -> Any:
        """See `StoredVolume`; a Dask array, which is computed before the worker gets it."""
        return self._array[self._slices(box)]


class MappedVolume(StoredVolume):
    """An array of a file, in its binary form: a memory map that every process makes for itself."""

    def __init__(self, mapped: np.memmap[Any, Any], name: str = "voxels", entry: Entry = ALL) -> None:
        """Args: a memory map that is no slice of another one, what to call it, and which part is the volume."""
        self._path = Path(str(mapped.filename))
        self._offset, self._order = mapped.offset, "F" if mapped.flags.f_contiguous else "C"
        self._whole_shape = mapped.shape
        chunks = contiguous(mapped.shape)
        super().__init__(name, mapped.shape, mapped.dtype, chunks[::-1] if self._order == "F" else chunks, entry)

    def read(self, box: Box) -> Values:
        """See `StoredVolume`."""
        with reading(self._path, "the NumPy reader"):
            shape: Any = self._whole_shape
            order: Any = self._order
            return np.array(np.memmap(self._path, self.dtype, "r", self._offset, shape, order)[self._slices(box)])


class PartOfVolume(StoredVolume):
    """A box of a stored volume, as a volume of its own."""

    def __init__(self, volume: StoredVolume, box: Box, name: str) -> None:
        """Args: the volume, the box in it, and what to call that."""
        chunks = tuple(_clipped(lengths, *side) for lengths, side in zip(volume.chunks, box, strict=True))
        super().__init__(name, [stop - start for start, stop in box], volume.dtype, chunks)
        self.placement = volume.placement
        self._volume, self._first = volume, tuple(start for start, _ in box)

    def at(self, box: Box) -> Any:
        """See `StoredVolume`."""
        return self._volume.at(self._moved(box))

    def read(self, box: Box) -> Values:
        """See `StoredVolume`."""
        return self._volume.read(self._moved(box))

    def _moved(self, box: Box) -> Box:
        x, y, z = ((start + first, stop + first) for (start, stop), first in zip(box, self._first, strict=True))
        return x, y, z


class LongerVolume(StoredVolume):
    """A periodic volume with its first layer once more after the last one of each periodic axis."""

    def __init__(self, volume: StoredVolume, periodic: Periodic) -> None:
        """Args: the volume, and along which axes its last layer touches the first."""
        shape = [n + wraps for n, wraps in zip(volume.shape, periodic, strict=True)]
        chunks = tuple(
            (*lengths[:-1], lengths[-1] + wraps) for lengths, wraps in zip(volume.chunks, periodic, strict=True)
        )
        super().__init__(volume.name, shape, volume.dtype, chunks)
        self.placement = volume.placement
        self._volume = volume

    def at(self, box: Box) -> Any:
        """See `StoredVolume`."""
        is_longer = any(stop > n for (_, stop), n in zip(box, self._volume.shape, strict=True))
        if is_longer and not isinstance(self._volume, DaskVolume | MemoryVolume):
            return super().at(box)
        return self._joined(box, self._volume.at)

    def read(self, box: Box) -> Values:
        """See `StoredVolume`."""
        return self._joined(box, self._volume.read)

    def _joined(self, box: Box, part: Callable[[Box], Any]) -> Any:
        """The values in a box, from what there is in boxes of the volume."""
        for axis, ((start, stop), n) in enumerate(zip(box, self._volume.shape, strict=True)):
            if stop > n:
                sides = [(start, n)] * (start < n) + [(0, stop - n)]
                boxes = ((*box[:axis], side, *box[axis + 1 :]) for side in sides)
                return np.concatenate([self._joined(one, part) for one in boxes], axis)  # type: ignore[arg-type]
        return part(box)


def _numpy_type(array: Any) -> DTypeLike:
    return getattr(array.dtype, "numpy_dtype", array.dtype)  # TensorStore has types of its own


def _chunks_of(array: Any) -> Sequence[int] | Lengths:
    layout = getattr(array, "chunk_layout", None)  # of TensorStore
    found = getattr(array, "shards", None) or getattr(array, "chunks", None)
    if layout is not None:
        found = layout.read_chunk.shape
    return found if found is not None and len(found) == len(array.shape) else contiguous(array.shape)


def contiguous(shape: Sequence[int]) -> tuple[int, ...]:
    """Chunks of an array without chunks: rows along its last axis."""
    return (*(1 for _ in shape[:-1]), *shape[-1:])


def _lengths(chunk: int | Sequence[int], n: int) -> tuple[int, ...]:
    if not isinstance(chunk, int):
        return tuple(map(int, chunk))
    chunk *= max(1, -(-n // (chunk * _MOST_CHUNKS)))
    return (chunk,) * (n // chunk) + ((n % chunk,) if n % chunk else ())


def _clipped(lengths: Sequence[int], start: int, stop: int) -> tuple[int, ...]:
    """The lengths of those parts of chunks that lie between two layers."""
    ends = list(accumulate(lengths, initial=0))
    parts = (min(b, stop) - max(a, start) for a, b in pairwise(ends))
    return tuple(part for part in parts if part > 0)
