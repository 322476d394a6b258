"""Volumes that stay where they are stored, and are read box by box: zarr, HDF5, memory maps, Dask arrays, and the like.

All of these can be sent to other processes, which then read for themselves. A Dask array around each of them would not
do: it goes through the graph of all chunks for every box, which takes 0.3 s for 2048³ voxels in chunks of 64³ and 1.6 s
for 8192³, instead of milliseconds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from itertools import accumulate, pairwise
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray
from torch import Tensor

from topokit.core.blocks.division import Box
from topokit.core.blocks.part import Periodic
from topokit.core.grid.placement import Placement
from topokit.errors import InputError, Option
from topokit.inputs.arrays import as_tensor
from topokit.inputs.reading import reading

Values = NDArray[Any]
Lengths = tuple[tuple[int, ...], ...]
_CHANNELS = ("c", "channel")  # names of the axis of channels
_MOST_CHUNKS = 1 << 20  # along an axis; beyond, neighbors count as one chunk, as their lengths take memory


def not_a_volume(shape: Sequence[int], names: Sequence[str] = ()) -> InputError:
    """The error about an array of another shape than (X, Y, Z)."""
    called = f" with the axes {', '.join(names)}" if names else ""
    says = f"the volume must have shape (X, Y, Z), got {tuple(shape)}{called}."
    if len(shape) == 2:
        return InputError(f"{says} One slice is a volume of one layer: pass image[None].")
    if len(shape) == 4:
        return InputError(
            f"{says} Of several channels or times pass ", Option("axis", "…"), " and ", Option("channel", "…"), "."
        )
    return InputError(says)


class Entry(NamedTuple):
    """Which part of a file or array is the volume: the arguments of `from_voxels` with these names."""

    dataset: str | None = None
    axis: int | str | None = None
    channel: int | None = None

    def chosen(self, shape: Sequence[int], names: Sequence[str]) -> dict[int, int]:
        """The number of the axis along which the channel is chosen, and the channel; empty if none is.

        Raises:
            InputError: if there is no such axis or channel.
        """
        if self.channel is None:
            if self.axis is not None:
                raise InputError(
                    Option("axis", repr(self.axis)), " needs ", Option("channel", "…"), ", a number along it."
                )
            return {}
        axis = next((name for name in _CHANNELS if name in names), None) if self.axis is None else self.axis
        held = f"an array of shape {tuple(shape)}" + (f" with the axes {', '.join(names)}" if names else "")
        if axis is None:
            raise InputError(f"{held} does not say which axis is that of channels: pass ", Option("axis", "…"), ".")
        place = {name: number for number, name in enumerate(names)}.get(str(axis), axis)
        if not isinstance(place, int) or not -len(shape) <= place < len(shape):
            raise InputError(f"{held} has no axis {axis!r}: give the name or the number of one.")
        if not 0 <= self.channel < shape[place]:
            raise InputError(f"{held} has no channel {self.channel} along axis {axis!r}, but {shape[place]} from 0 on.")
        return {place % len(shape): self.channel}


ALL = Entry()
"""The only array there is, and the only channel."""


def volume_axes(shape: Sequence[int], besides: Collection[int] = ()) -> tuple[int, ...]:
    """The axes of an array that are those of a volume: all but as many of length one as there are too many.

    So times and channels of which there is one are left out: axes 2, 3 and 4 of (1, 1, Z, Y, X).

    Args:
        shape: of the array.
        besides: axes that are none of the volume.
    """
    axes = [axis for axis in range(len(shape)) if axis not in besides]
    ones = [axis for axis in axes if shape[axis] == 1][: max(0, len(axes) - 3)]
    return tuple(axis for axis in axes if axis not in ones)


def volume_index(shape: Sequence[int], entry: Entry = ALL, names: Sequence[str] = ()) -> tuple[slice | int, ...]:
    """How an array is indexed to get its volume.

    Args:
        shape: of the array.
        entry: which part of it is the volume.
        names: of its axes, if it has any.

    Raises:
        InputError: if there are not three axes left, or there is no such part.
    """
    chosen = entry.chosen(shape, names)
    axes = volume_axes(shape, chosen)
    if len(axes) != 3 or not all(n > 0 for n in shape):  # Dask knows lengths as NaN, too
        raise not_a_volume(shape, names)
    return tuple(slice(None) if axis in axes else chosen.get(axis, 0) for axis in range(len(shape)))


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


class HdfVolume(StoredVolume):
    """A data set in an HDF5 file; other processes open the file for themselves."""

    def __init__(
        self, dataset: Any, name: str = "voxels", placement: Placement | None = None, entry: Entry = ALL
    ) -> None:
        """Args: an `h5py.Dataset`, what to call it, where its voxels are, if known, and which part is the volume."""
        shape, names = dataset.shape or (), tuple(axis.label for axis in dataset.dims if axis.label)
        super().__init__(
            name, shape, dataset.dtype, dataset.chunks or _contiguous(shape), entry, names * (len(names) == len(shape))
        )
        self.placement = placement
        self._path, self._place, self._dataset = Path(dataset.file.filename).absolute(), dataset.name, dataset

    def read(self, box: Box) -> Values:
        """See `StoredVolume`."""
        with reading(self._path, "h5py", MemoryError):
            if self._dataset is None:
                import h5py

                self._dataset = h5py.File(self._path, "r")[self._place]
            return np.asarray(self._dataset[self._slices(box)])

    def __getstate__(self) -> dict[str, Any]:
        """What is sent to another process: all but the open file."""
        return vars(self) | {"_dataset": None}


class MappedVolume(StoredVolume):
    """An array of a file, in its binary form: a memory map that every process makes for itself."""

    def __init__(self, mapped: np.memmap[Any, Any], name: str = "voxels", entry: Entry = ALL) -> None:
        """Args: a memory map that is no slice of another one, what to call it, and which part is the volume."""
        self._path = Path(str(mapped.filename))
        self._offset, self._order = mapped.offset, "F" if mapped.flags.f_contiguous else "C"
        self._whole_shape = mapped.shape
        chunks = _contiguous(mapped.shape)
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


def stored_array(volume: object, entry: Entry = ALL, names: Sequence[str] = ()) -> StoredVolume | None:
    """An array that can be read box by box; None for what is in memory already, or is no array.

    Args:
        volume: the array.
        entry: which part of it is the volume.
        names: of its axes, if it has none itself.
    """
    kind = type(volume).__module__.partition(".")[0]
    if kind == "xarray" and hasattr(volume, "coords"):
        array: Any = volume
        found = stored_array(array.data, entry, tuple(map(str, array.dims)))
        if found is not None:
            found.placement = placement_of_xarray(array, entry)
        return found
    if kind == "h5py" and hasattr(volume, "file"):
        return HdfVolume(volume, entry=entry)
    if kind == "dask" and hasattr(volume, "dask"):
        return DaskVolume(volume, entry=entry, names=names)
    if isinstance(volume, np.memmap):
        whole = volume.base is not None and not isinstance(volume.base, np.memmap) and volume.filename is not None
        is_plain = whole and volume.flags.forc
        return MappedVolume(volume, entry=entry) if is_plain else IndexedVolume(volume, entry=entry, names=names)
    is_array = hasattr(volume, "shape") and hasattr(volume, "dtype") and hasattr(volume, "__getitem__")
    if not is_array or isinstance(volume, np.ndarray | Tensor) or not _is_lazy(volume):
        return None
    return IndexedVolume(volume, entry=entry, names=names or axis_names(volume))


def axis_names(array: Any) -> tuple[str, ...]:
    """The names that an array of zarr or xarray gives its axes, if it does."""
    names = getattr(array, "dims", None) or getattr(getattr(array, "metadata", None), "dimension_names", None) or ()
    return tuple(map(str, names))


def placement_of_xarray(array: Any, entry: Entry = ALL) -> Placement | None:
    """Where the voxels of an `xarray.DataArray` are by the coordinates of its axes; None if an axis has none.

    Raises:
        InputError: if they are not evenly spaced.
    """
    chosen = entry.chosen(array.shape, tuple(map(str, array.dims)))
    names = [array.dims[axis] for axis in volume_axes(array.shape, chosen)]
    if len(names) != 3 or not all(name in array.coords and array.sizes[name] > 1 for name in names):
        return None
    ticks = [np.asarray(array.coords[name].values, dtype=float) for name in names]
    steps = [(one[-1] - one[0]) / (len(one) - 1) for one in ticks]
    for name, one, step in zip(names, ticks, steps, strict=True):
        if not np.allclose(np.diff(one), step, rtol=1e-3, atol=0):
            raise InputError(f"the coordinates along {name!r} are not evenly spaced: interpolate them first.")
    units = {str(array.coords[name].attrs.get("units", "")) for name in names}
    affine = np.diag([*steps, 1.0])
    affine[:3, 3] = [one[0] for one in ticks]
    return Placement.of_affine(affine, units.pop() if len(units) == 1 else "")


def in_memory_array(volume: object, entry: Entry = ALL) -> StoredVolume:
    """An array or tensor in memory, to be read box by box all the same."""
    return MemoryVolume(as_tensor(volume, "the volume", "(X, Y, Z)").detach().cpu().numpy(), entry=entry)


def _is_lazy(volume: object) -> bool:
    return hasattr(volume, "chunks") or hasattr(volume, "chunk_layout")


def _numpy_type(array: Any) -> DTypeLike:
    return getattr(array.dtype, "numpy_dtype", array.dtype)  # TensorStore has types of its own


def _chunks_of(array: Any) -> Sequence[int] | Lengths:
    layout = getattr(array, "chunk_layout", None)  # of TensorStore
    found = getattr(array, "shards", None) or getattr(array, "chunks", None)
    if layout is not None:
        found = layout.read_chunk.shape
    return found if found is not None and len(found) == len(array.shape) else _contiguous(array.shape)


def _contiguous(shape: Sequence[int]) -> tuple[int, ...]:
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
