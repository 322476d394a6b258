"""Where the labels of a labeled volume are: one pass for all of them instead of one for each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from topokit.errors import InputError, Option

Box = tuple[slice, slice, slice]

_MOST_DIRECT = 1 << 16  # labels up to here index SciPy's table of boxes as they are; others are numbered first


def label_boxes(labels: Tensor) -> dict[int, Box]:
    """The box of every label but 0, with one layer of voxels around it where the volume goes on.

    A solid {labels == label} has the same topology in its box as in the whole volume, and touches a side of the box
    only where the volume ends.

    Args:
        labels: (X, Y, Z) whole numbers of any real dtype; 0 and NaN are background.

    Returns:
        Boxes by label, in ascending order.

    Raises:
        InputError: if a value is not a whole number.
    """
    values = labels.detach().cpu().numpy()
    return {label: widened(box, values.shape) for label, box in sorted(tight_boxes(values).items())}


def tight_boxes(values: NDArray[Any]) -> dict[int, Box]:
    """The box of every label but 0, without anything around it; arguments and errors as for `label_boxes`."""
    values = whole_numbers(values)
    names, index = None, values
    if values.size and (values.min() < 0 or values.max() > _MOST_DIRECT):
        names, index = np.unique(values, return_inverse=True)
        index = index.reshape(values.shape) + 1
    found = ndimage.find_objects(index.astype(np.int32, copy=False))
    boxes = {int(names[k] if names is not None else k + 1): box for k, box in enumerate(found) if box is not None}
    return {label: box for label, box in boxes.items() if label != 0}


def joined_boxes(one: dict[int, Box], other: dict[int, Box]) -> dict[int, Box]:
    """The boxes of the labels of two parts of a volume."""
    both = {label: around(one[label], other[label]) for label in one.keys() & other.keys()}
    return one | other | both


def whole_numbers(values: NDArray[Any]) -> NDArray[Any]:
    """The values of labels, those of a floating type as integers; NaN becomes 0.

    Raises:
        InputError: if a value is not a whole number.
    """
    if values.dtype.kind != "f":
        return values
    whole = np.where(np.isnan(values), 0, values)
    if not (np.isfinite(whole).all() and (whole == np.rint(whole)).all()):
        raise InputError(
            f"the volume holds gray values, from {whole.min():g} to {whole.max():g}; labels are whole numbers. Pass ",
            *(Option("level", "…"), " for the solid above a level."),
        )
    return whole.astype(np.int64)


def around(one: Box, other: Box) -> Box:
    """The box around two boxes."""
    x, y, z = (slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(one, other, strict=True))
    return x, y, z


def widened(box: Box, shape: tuple[int, ...]) -> Box:
    """The box with one layer of voxels around it where a volume of this shape goes on."""
    x, y, z = (slice(max(0, side.start - 1), min(n, side.stop + 1)) for side, n in zip(box, shape, strict=True))
    return x, y, z
