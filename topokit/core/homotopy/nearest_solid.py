"""Search for the nearest solid with given Betti numbers to the solid {field > 0} on a grid.

Shifting the level of a field removes parts, tunnels and cavities one after the other: {field > t} has the wanted Betti
numbers for some levels t, if not for 0. The solid at the nearest such level is deformed back toward {field > 0} as far
as its topology allows. Because noise hides levels, the search also smooths the field by one and by two cells. Because
no level removes a part that is thicker than the body, it also tries dropping the smallest parts and filling the
smallest cavities. The candidate that changes the field least wins. If no candidate has all Betti numbers right, the
search continues from the one that is closest to them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label

from topokit.core.arrays import Booleans
from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.euler import critical_index
from topokit.core.homotopy.deformation import deform

Betti = tuple[int, int, int]
Change = Literal["any", "add", "remove"]
Values = NDArray[np.floating]

_SCALES = (0.0, 1.0, 2.0)  # smoothing, in cells
_LEVELS = 8  # tried per scale
_TILT = 1e-3  # height of the tilt over the whole grid, as a share of `_level_offset`
_CORNERS = np.ones((3, 3, 3))  # for labels: 26-connected, whatever the connectivity of the solid
_STAGES = 4  # maximum number of successive level shifts


class _Candidate(NamedTuple):
    distance: int  # from the wanted Betti numbers, see `_betti_distance`
    cost: float  # see `cost`
    solid: Booleans


def nearest_solid(
    field: Values, betti: Betti, change: Change = "any", connectivity: int | None = None
) -> Booleans | None:
    """The solid with given Betti numbers that is nearest to {field > 0}, or None if none was found.

    The distance between solids is that of `cost`. The search is a heuristic: there may be a nearer solid.

    Args:
        field: (X, Y, Z), positive inside, finite.
        betti: wanted numbers of components, tunnels and cavities of the solid.
        change: whether voxels may only be added to the solid ("add"), only removed from it ("remove"), or both ("any").
        connectivity: 6 or 26, that of the solid; None asks for the Betti numbers in both. Then any mesher agrees,
            unless voxels meet through an edge or a corner only, as in noise.

    Returns:
        (X, Y, Z) bool.
    """
    solid = field > 0
    distance = _betti_distance(solid, betti, connectivity)
    if distance and (field == 0).any():  # zeros are background, as in a clamped field: give them its sign
        field = np.where(field == 0, -min(_level_offset(field), 1.0), field).astype(field.dtype)
    for _ in range(_STAGES):
        if distance == 0:
            return solid
        best = min(_candidates(field, betti, change, connectivity), default=None, key=lambda one: one[:2])
        if best is None or best.distance >= distance:
            return None
        solid, distance = best.solid, best.distance
        field = np.where(solid == (field > 0), field, -field)
    return solid if distance == 0 else None


def _candidates(field: Values, betti: Betti, change: Change, connectivity: int | None) -> Iterator[_Candidate]:
    """The pruned solid, and for each scale the best solids from raising and from lowering the level."""
    present, tilted = field > 0, _tilt(field)
    pruned = _prune(field, betti, change)
    if not np.array_equal(pruned, present):
        yield _Candidate(_betti_distance(pruned, betti, connectivity), cost(field, pruned), pruned)
    for scale in _SCALES:
        smooth = gaussian_filter(tilted, scale, mode="nearest", truncate=3.0) if scale else tilted
        best: dict[bool, tuple[int, Booleans]] = {}
        for level in _candidate_levels(smooth, betti, change, connectivity or 6):
            raised = level > 0
            if raised in best and any(distance == 0 for distance, _ in best.values()):
                continue  # a level fits: one try in the other direction is enough
            above = smooth > level
            template = above | present if change == "add" else above & present if change == "remove" else above
            distance = _betti_distance(template, betti, connectivity)
            if raised not in best or distance < best[raised][0]:
                best[raised] = distance, template
        for distance, template in best.values():
            solid = deform(template, present, connectivity)
            yield _Candidate(distance, cost(field, solid), solid)


def _prune(field: Values, betti: Betti, change: Change) -> Booleans:
    """The solid without its surplus components and cavities, those of least cost being dropped or filled."""
    solid = field > 0
    if change != "add":
        labels, count = label(solid, _CORNERS)
        solid &= ~_cheapest_labels(field, labels, range(1, count + 1), count - betti[0])
    if change != "remove":
        labels, count = label(np.pad(~solid, 1, constant_values=True), _CORNERS)
        enclosed = [region for region in range(1, count + 1) if region != labels[0, 0, 0]]
        solid |= _cheapest_labels(field, labels[1:-1, 1:-1, 1:-1], enclosed, len(enclosed) - betti[2])
    return solid


def _cheapest_labels(field: Values, labels: NDArray[np.int32], among: Sequence[int], number: int) -> Booleans:
    """Voxels of that number of labels whose values have the least sum of squares."""
    if number <= 0:
        return np.zeros(field.shape, dtype=bool)
    costs = np.zeros(labels.max() + 1)
    for layer, values in zip(labels, field, strict=True):  # float64 copies of one layer at a time
        costs += np.bincount(layer.ravel(), weights=np.square(values, dtype=np.float64).ravel(), minlength=len(costs))
    chosen = np.zeros(len(costs), dtype=bool)
    chosen[sorted(among, key=lambda one: costs[one])[:number]] = True
    return chosen[labels]


def cost(field: Values, solid: Booleans) -> float:
    """Sum of squares of the values that must change sign for {field > 0} to become the solid; inf on overflow."""
    with np.errstate(over="ignore"):
        return float(np.square(field[solid != (field > 0)], dtype=np.float64).sum())


def _candidate_levels(field: Values, betti: Betti, change: Change, connectivity: int) -> list[float]:
    """Levels whose Euler characteristic is nearest to the wanted one; among equals those nearest to zero come first.

    Where both connectivities count, 6 finds more: a level that splits parts in it mostly splits them in 26, too.
    """
    index = critical_index(field, connectivity).numpy()
    values, jumps = field[index != 0], index[index != 0]
    order = np.argsort(-values, kind="stable")
    upper, euler = values[order], np.cumsum(jumps[order], dtype=np.int64)  # χ just below each critical value
    lower = np.append(upper[1:], field.min() - max(abs(float(field.min())), 1.0))  # below all values: the whole grid
    middle, half = (upper + lower) / 2, (upper - lower) / 2
    level = np.sign(middle) * np.maximum(np.abs(middle) - half + np.minimum(half, _level_offset(field)), 0)
    allowed = half > 0
    if change != "any":
        allowed &= level <= 0 if change == "add" else level >= 0
    off = np.abs(euler - (betti[0] - betti[1] + betti[2]))
    best = np.lexsort((np.abs(level), off, ~allowed))[:_LEVELS]
    return [float(level[k]) for k in best if allowed[k]]


def _level_offset(field: Values) -> float:
    """Distance of a level from the critical value it has to pass: a quarter of the mean change over a cell, if any."""
    changes = []
    for axis in range(3):
        change = np.diff(field, axis=axis)
        changes.append(float(np.abs(change, out=change).mean()) if change.size else 0.0)
    return 0.25 * max(changes) or np.inf


def _tilt(field: Values) -> Values:
    """The field plus a slight slope, so that the critical points of a symmetric field have different values."""
    height = _TILT * _level_offset(field)
    if height == np.inf:
        return field
    tilted = field.copy()
    for along, rise in zip(np.ogrid[tuple(map(slice, field.shape))], (1, 0.755, 0.57), strict=True):  # no simple ratios
        tilted += (height * rise / sum(field.shape) * along).astype(field.dtype)
    return tilted


def _betti_distance(solid: Booleans, betti: Betti, connectivity: int | None) -> int:
    """Sum of differences from the wanted Betti numbers; for both connectivities the larger sum."""
    wanted = torch.tensor(betti)
    both = (6, 26) if connectivity is None else (connectivity,)
    return max(int((betti_numbers(solid, connectivity=one) - wanted).abs().sum()) for one in both)
