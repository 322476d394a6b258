"""The solid of a wanted topology that is nearest to the one a field on a grid describes.

Moving the level of a field removes parts, tunnels and cavities one after the other: {field > t} has the wanted Betti
numbers for some levels t, if not for 0. The solid at the nearest such level is then moved back towards {field > 0} as
far as its topology allows. Noise hides levels, so the field is also looked at smoothed by one and by two cells; and
parts thicker than the body are at no level gone before it, so dropping the slightest parts and filling the slightest
cavities is tried, too. Of several solids the one that asks for the least change of the field is taken. Where none has
all of the numbers right, the one that comes nearest is taken, and the search goes on from there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label

from topokit.core.grid.components import betti_numbers
from topokit.core.grid.euler import critical_index
from topokit.core.homotopy.deformation import deform
from topokit.core.homotopy.simple_points import Bools

Betti = tuple[int, int, int]
Change = Literal["any", "add", "remove"]
Values = NDArray[np.floating]

_SCALES = (0.0, 1.0, 2.0)  # smoothing, in cells
_LEVELS = 8  # tried per scale
_TILT = 1e-3  # of a typical depth, over the whole grid
_CORNERS = np.ones((3, 3, 3))  # for labels: what touches at a corner is one, whatever the connectivity
_STAGES = 4  # of which each mends what one movement of the level can


class _Candidate(NamedTuple):
    missing: int  # total difference of Betti numbers
    cost: float  # sum of squares of the values that would have to change sign
    solid: Bools


def nearest_solid(field: Values, betti: Betti, change: Change = "any", connectivity: int | None = None) -> Bools | None:
    """The solid with given Betti numbers that is nearest to {field > 0}, or None if none was found.

    It differs from {field > 0} by what has to change, and by nothing else that could be kept.

    Args:
        field: (X, Y, Z), positive inside, finite.
        betti: wanted numbers of components, tunnels and cavities of the solid.
        change: whether voxels may only be added to the solid, only removed from it, or both.
        connectivity: 6 or 26, that of the solid; None asks for the Betti numbers in both. Any mesher agrees
            then, unless voxels meet through an edge or a corner alone, as in noise.

    Returns:
        (X, Y, Z) bool.
    """
    solid = field > 0
    missing = _missing(solid, betti, connectivity)
    if missing and (field == 0).any():  # background as flat as that of a clamped field has no sign to change
        field = np.where(field == 0, -min(_depth(field), 1.0), field).astype(field.dtype)
    for _ in range(_STAGES):
        if missing == 0:
            return solid
        best = min(_candidates(field, betti, change, connectivity), default=None, key=lambda one: one[:2])
        if best is None or best.missing >= missing:
            return None
        solid, missing = best.solid, best.missing
        field = np.where(solid == (field > 0), field, -field)
    return solid if missing == 0 else None


def _candidates(field: Values, betti: Betti, change: Change, connectivity: int | None) -> Iterator[_Candidate]:
    """The solid without its slightest parts, and the best ones of each scale, by raising and by lowering the level."""
    present, tilted = field > 0, _tilted(field)
    pruned = _pruned(field, betti, change)
    if not np.array_equal(pruned, present):
        yield _Candidate(_missing(pruned, betti, connectivity), cost(field, pruned), pruned)
    for scale in _SCALES:
        smooth = gaussian_filter(tilted, scale, mode="nearest", truncate=3.0) if scale else tilted
        best: dict[bool, tuple[int, Bools]] = {}
        for level in _levels(smooth, betti, change):
            raised = level > 0
            if raised in best and any(missing == 0 for missing, _ in best.values()):
                continue  # one fits: the other way is tried once
            above = smooth > level
            template = above | present if change == "add" else above & present if change == "remove" else above
            missing = _missing(template, betti, connectivity)
            if raised not in best or missing < best[raised][0]:
                best[raised] = missing, template
        for missing, template in best.values():
            solid = deform(template, present, connectivity)
            yield _Candidate(missing, cost(field, solid), solid)


def _pruned(field: Values, betti: Betti, change: Change) -> Bools:
    """The solid without the components, and with the cavities filled, that are too many and cost the least."""
    solid = field > 0
    if change != "add":
        labels, count = label(solid, _CORNERS)
        solid &= ~_cheapest(field, labels, range(1, count + 1), count - betti[0])
    if change != "remove":
        labels, count = label(np.pad(~solid, 1, constant_values=True), _CORNERS)
        enclosed = [region for region in range(1, count + 1) if region != labels[0, 0, 0]]
        solid |= _cheapest(field, labels[1:-1, 1:-1, 1:-1], enclosed, len(enclosed) - betti[2])
    return solid


def _cheapest(field: Values, labels: NDArray[np.int32], among: Sequence[int], number: int) -> Bools:
    """Voxels of the labels whose values have the least sum of squares."""
    if number <= 0:
        return np.zeros(field.shape, dtype=bool)
    costs = np.zeros(labels.max() + 1)
    for mine, values in zip(labels, field, strict=True):  # layer by layer: the sums need wide numbers
        costs += np.bincount(mine.ravel(), weights=np.square(values, dtype=np.float64).ravel(), minlength=len(costs))
    chosen = np.zeros(len(costs), dtype=bool)
    chosen[sorted(among, key=lambda one: costs[one])[:number]] = True
    return chosen[labels]


def cost(field: Values, solid: Bools) -> float:
    """Sum of squares of the values that would have to change sign; infinite where that overflows."""
    with np.errstate(over="ignore"):
        return float(np.square(field[solid != (field > 0)], dtype=np.float64).sum())


def _levels(field: Values, betti: Betti, change: Change) -> list[float]:
    """Levels whose solid has the wanted Euler characteristic or is near to having it, the nearest level first."""
    index = critical_index(field, 6).numpy()
    values, jumps = field[index != 0], index[index != 0]
    order = np.argsort(-values, kind="stable")
    upper, euler = values[order], np.cumsum(jumps[order], dtype=np.int64)  # just below each value
    lower = np.append(upper[1:], field.min() - max(abs(float(field.min())), 1.0))  # below all: the grid is the solid
    middle, half = (upper + lower) / 2, (upper - lower) / 2
    level = np.sign(middle) * np.maximum(np.abs(middle) - half + np.minimum(half, _depth(field)), 0)
    allowed = half > 0
    if change != "any":
        allowed &= level <= 0 if change == "add" else level >= 0
    off = np.abs(euler - (betti[0] - betti[1] + betti[2]))
    best = np.lexsort((np.abs(level), off, ~allowed))[:_LEVELS]
    return [float(level[k]) for k in best if allowed[k]]


def _depth(field: Values) -> float:
    """How far beyond a critical value a level is taken: a quarter of the field's typical change over a cell, if any."""
    changes = []
    for axis in range(3):
        change = np.diff(field, axis=axis)
        changes.append(float(np.abs(change, out=change).mean()) if change.size else 0.0)
    return 0.25 * max(changes) or np.inf


def _tilted(field: Values) -> Values:
    """The field on a slope far too gentle to matter, so that what is symmetric does not all happen at one level."""
    depth = _depth(field)
    if depth == np.inf:
        return field
    tilted = field.copy()
    for along, rise in zip(np.ogrid[tuple(map(slice, field.shape))], (1, 0.755, 0.57), strict=True):  # no simple ratios
        tilted += (_TILT * depth * rise / sum(field.shape) * along).astype(field.dtype)
    return tilted


def _missing(solid: Bools, betti: Betti, connectivity: int | None) -> int:
    """Total difference from the wanted Betti numbers; the larger of the two connectivities' if both count."""
    wanted = torch.tensor(betti)
    both = (6, 26) if connectivity is None else (connectivity,)
    return max(int((betti_numbers(solid, connectivity=one) - wanted).abs().sum()) for one in both)
