"""Which part of a file or array is the volume: the data set, the channel, and the axes that are left."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from topokit.errors import InputError, Option, ReadError

_CHANNELS = ("c", "channel")  # names of the axis of channels


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


def axis_names(array: Any) -> tuple[str, ...]:
    """The names that an array of zarr or xarray gives its axes, if it does."""
    names = getattr(array, "dims", None) or getattr(getattr(array, "metadata", None), "dimension_names", None) or ()
    return tuple(map(str, names))


def chosen_array(path: Path | str, shapes: dict[str, tuple[int, ...]], entry: Entry) -> str:
    """The path of the array that is wanted, or of the only volume."""
    dataset = entry.dataset
    if dataset is not None and dataset.strip("/") in shapes:
        return dataset.strip("/")
    volumes = [name for name, shape in shapes.items() if len(volume_axes(shape)) == 3 + (entry.channel is not None)]
    if dataset is None and len(volumes) == 1:
        return volumes[0]
    held = ", ".join(_described(shapes)) or "no array"
    if dataset is not None:
        raise ReadError(f"{path} has no array {dataset!r}. It holds {held}.")
    wanted = "pass ", Option("dataset", "…"), ", the path of an array with three axes."
    raise InputError(f"{path} holds {held}: ", *wanted, file=path)


def _described(shapes: dict[str, tuple[int, ...]], most: int = 10) -> Iterator[str]:
    for number, (name, shape) in enumerate(shapes.items()):
        if number == most:
            yield f"and {len(shapes) - most} more"
            return
        yield f"{name} {shape}"
