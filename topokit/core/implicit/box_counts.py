"""What a box of a field adds to the counts of its grid: the boxes' numbers sum to those of the grid, however it is cut.

χ is counted by cubes of 2 × 2 × 2 vertices in which the sign changes. Of shifted levels, which are not known before the
whole grid has been seen, the critical vertices near level 0 are kept: they are few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import pad

from topokit.core.blocks.cubes import cube_tables
from topokit.core.grid.euler import at_least_single, critical_index
from topokit.core.implicit.adaptive_grid import NONE, AdaptiveField, Box, Refined, over_cells
from topokit.core.implicit.unseen_parts import lone_vertices

ReachedFaces = tuple[tuple[bool, bool], ...]

_DROPPED_BITS = 15  # of a change in single precision: 8 of its mantissa stay, which is 0.4 %
_CHUNK = 1 << 18  # critical vertices classified together, with their 26 neighbors


@dataclass(frozen=True, eq=False)
class BoxCounts:
    """The numbers of a box; those of the vertices and cubes that begin in it.

    Attributes:
        codes: (256,) cubes by their inside corners, as in `blocks.cubes`, constant ones left out.
        bins: (K,) ascending, rounded changes of the field along the edges that cross the zero set; see `rounded`.
        bin_counts: (K,) how many edges have them.
        critical: (M,) values within the window at vertices where the index does not vanish.
        index_26, index_6: (M,) indices there, with either connectivity.
        reached_faces: for each axis, whether the solid is in the first and in the last layer of the grid.
        lone: flat indices on the grid, see `unseen.lone_vertices`; none unless they are asked for.
        followed: see `adaptive_grid.Refined`.
        n_evaluations: points at which the field was evaluated.
    """

    codes: NDArray[np.int64]
    bins: Tensor
    bin_counts: Tensor
    critical: Tensor
    index_26: Tensor
    index_6: Tensor
    reached_faces: ReachedFaces
    lone: Tensor
    followed: Tensor
    n_evaluations: int


def count_quiet_box(is_inside: bool, box: Box, shape: tuple[int, int, int], dtype: torch.dtype) -> BoxCounts:
    """The numbers of a box in which the sign does not change and no value is within the window.

    Where it is inside and at the border of its grid, the sign does change there: beyond is background.

    Args:
        is_inside: whether the box is.
        box: of a grid of this shape.
        shape: of the grid.
        dtype: of the field.
    """
    (low_x, high_x), (low_y, high_y), (low_z, high_z) = ends = [
        (int(a == 0), int(b == n)) for (a, b), n in zip(box, shape, strict=True)
    ]
    codes = np.zeros(256, dtype=np.int64)
    if is_inside and any(map(any, ends)):
        inside = torch.ones([b - a for a, b in box], dtype=torch.bool)
        codes = _codes(pad(inside, (low_z, high_z, low_y, high_y, low_x, high_x)))
    reached = tuple((bool(is_inside and low), bool(is_inside and high)) for low, high in ends)
    no_values = torch.zeros(0, dtype=dtype)
    return BoxCounts(codes, NONE, NONE, no_values, NONE, NONE, reached, NONE, NONE, 0)


def count_box(refined: Refined, box: Box, window: float, finds_lone: bool = False) -> BoxCounts:
    """The numbers of a box of a field.

    Args:
        refined: the field in a box that has one more vertex on all sides where the grid has one; three more to find
            lone vertices.
        box: of the grid.
        window: values up to this distance from 0 are searched for critical ones.
        finds_lone: whether to find lone vertices.
    """
    field, shape = refined.field, refined.field.grid.shape
    values = _with_neighbors(field, box, shape)
    core = values[1:-1, 1:-1, 1:-1]
    lows = tuple(slice(int(a > 0), None) for a, _ in box)  # cubes begin in the box, or in the layer before the grid
    inside = values[lows] > 0
    bins, bin_counts = _changes(values, box, shape)
    critical, index_26, index_6 = _critical(values, core, window)
    inner = core > 0
    reached = tuple(
        (a == 0 and bool(inner.select(axis, 0).any()), b == n and bool(inner.select(axis, -1).any()))
        for axis, ((a, b), n) in enumerate(zip(box, shape, strict=True))
    )
    return BoxCounts(
        codes=_codes(inside),
        bins=bins,
        bin_counts=bin_counts,
        critical=critical,
        index_26=index_26,
        index_6=index_6,
        reached_faces=reached,
        lone=lone_vertices(field, box) if finds_lone else NONE,
        followed=refined.followed,
        n_evaluations=field.n_evaluations,
    )


def eulers_26_and_6(codes: NDArray[np.int64]) -> tuple[int, int]:
    """χ of the surface with either connectivity, of a grid whose cubes have these codes."""
    weights = cube_tables().weights[:, 0]
    return int(codes @ weights[::-1]) // 4, int(codes @ weights) // 4


def rounded(changes: Tensor) -> Tensor:
    """Positive numbers as int32 that order as they do, rounded down by at most 0.4 %."""
    return changes.float().contiguous().view(torch.int32) >> _DROPPED_BITS


def value_of(rounded_change: int) -> float:
    """The number that `rounded` stands for."""
    return float(torch.tensor(rounded_change << _DROPPED_BITS, dtype=torch.int32).view(torch.float32))


def median_change(boxes: Sequence[BoxCounts]) -> float | None:
    """The rounded median of the changes over all edges that cross the zero set, the lower one of two; None for none."""
    bins = torch.cat([one.bins for one in boxes])
    if not len(bins):
        return None
    bins, place = bins.unique(return_inverse=True)
    counts = torch.zeros(len(bins), dtype=torch.int64)
    counts.index_add_(0, place, torch.cat([one.bin_counts for one in boxes]))
    before = counts.cumsum(0)
    return value_of(int(bins[torch.searchsorted(before, (int(before[-1]) + 1) // 2)]))


def eulers_at(boxes: Sequence[BoxCounts], level: float) -> tuple[int, int]:
    """χ of the surface of {F > level} with either connectivity; the level is within the window of the boxes."""
    total_26, total_6 = eulers_26_and_6(sum(one.codes for one in boxes))  # type: ignore[arg-type]
    for one in boxes:
        lost = (one.critical > 0).int() - (one.critical > level).int()
        total_26 -= 2 * int((lost * one.index_26).sum())
        total_6 -= 2 * int((lost * one.index_6).sum())
    return total_26, total_6


def _with_neighbors(field: AdaptiveField, box: Box, shape: tuple[int, int, int]) -> Tensor:
    """The values of a box with those around it; −∞ beyond the grid."""
    x, y, z = ((max(0, a - 1), min(n, b + 1)) for (a, b), n in zip(box, shape, strict=True))
    missing = [side for (a, b), n in zip(box, shape, strict=True) for side in (int(a == 0), int(b == n))]
    last_axis_first = [missing[k] for k in (4, 5, 2, 3, 0, 1)]
    return pad(field.part((x, y, z)).values, last_axis_first, value=float("-inf"))


def _codes(inside: Tensor) -> NDArray[np.int64]:
    """How many cubes have each code, constant ones left out."""
    changes = over_cells(inside, torch.logical_or) & ~over_cells(inside, torch.logical_and)
    x, y, z = changes.nonzero().unbind(1)
    code = torch.zeros(len(x), dtype=torch.int64)
    for corner in range(8):
        code |= inside[x + (corner >> 1 & 1), y + (corner & 1), z + (corner >> 2 & 1)].long() << corner
    return torch.bincount(code, minlength=256).numpy()


def _changes(values: Tensor, box: Box, shape: tuple[int, int, int]) -> tuple[Tensor, Tensor]:
    """The rounded changes along edges of the grid that begin in the box and cross the zero set, and their number."""
    found = []
    for axis in range(3):
        own = [slice(1, -1)] * 3
        lower = values[tuple(own)]
        own[axis] = slice(2, None)
        upper = values[tuple(own)]
        if box[axis][1] == shape[axis]:
            n = lower.shape[axis] - 1
            lower, upper = lower.narrow(axis, 0, n), upper.narrow(axis, 0, n)
        crossing = (lower > 0) != (upper > 0)
        found.append((at_least_single(upper[crossing]) - at_least_single(lower[crossing])).abs())
    changes = torch.cat(found)
    bins, counts = rounded(changes[changes.isfinite()]).unique(return_counts=True)
    return bins, counts


def _critical(values: Tensor, core: Tensor, window: float) -> tuple[Tensor, Tensor, Tensor]:
    """The critical values within the window and their indices with connectivity 26 and 6."""
    near = (core.abs() <= window).nonzero() if window > 0 else NONE.reshape(0, 3)
    found = [(core.new_zeros(0), NONE, NONE)]
    offsets = torch.cartesian_prod(*(torch.arange(3),) * 3)
    for part in near.split(_CHUNK):
        x, y, z = (part[:, None] + offsets).unbind(-1)
        around = values[x, y, z].reshape(-1, 3, 3, 3)
        own, index_26, index_6 = around[:, 1, 1, 1], critical_index(around, 26), critical_index(around, 6)
        index_26, index_6 = index_26[:, 1, 1, 1].long(), index_6[:, 1, 1, 1].long()
        kept = (index_26 != 0) | (index_6 != 0)
        found.append((own[kept], index_26[kept], index_6[kept]))
    critical, index_26, index_6 = (torch.cat(column) for column in zip(*found, strict=True))
    return critical, index_26, index_6
