"""Comparing two solids that are given voxel by voxel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np

from topokit.comparison.agreement import Agreement, agreement, dice
from topokit.comparison.result import Bounds, Comparison, Difference, Kind, Matching
from topokit.core.arrays import Booleans
from topokit.core.comparison.pair import SolidPair
from topokit.core.comparison.places import Box, Found, Places
from topokit.core.comparison.tie_broken import betti_matched
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.core.grid.grid import Grid
from topokit.core.grid.placement import Placement
from topokit.core.loops import middle
from topokit.errors import InputError, Option
from topokit.report.location import Place

_KINDS: tuple[dict[tuple[int, str], Kind], dict[tuple[int, str], Kind]] = (
    {
        (0, "alone"): "extra part",
        (0, "divided"): "split part",
        (1, "filled"): "hole",
        (1, "absent"): "bridge",
        (2, "alone"): "bubble",
        (2, "divided"): "split cavity",
        (2, "outside"): "sealed cavity",
    },
    {
        (0, "alone"): "lost part",
        (0, "divided"): "merged part",
        (1, "filled"): "filled tunnel",
        (1, "absent"): "broken loop",
        (2, "alone"): "filled cavity",
        (2, "divided"): "merged cavity",
        (2, "outside"): "opened cavity",
    },
)
_PLACES = (
    "Matched features are counted by Betti matching, whose ties depend on the position in the grid; the features that "
    "are listed are those of the invariant matching."
)
_MOST_LOOPS = 100  # of a kind; each is a search of milliseconds


def compare_solids(
    first: Booleans,
    second: Booleans,
    grid: Grid | None = None,
    *,
    placement: Placement | None = None,
    connectivity: int | None = None,
    matching: Matching = "invariant",
    tolerance: float | None = None,
    names: tuple[str, str] = ("a", "b"),
    resolution: float | None = None,
    notes: tuple[str, ...] = (),
) -> Comparison:
    """Compare two solids on one grid; either may be empty.

    Args:
        first: (X, Y, Z), whether a voxel is in the solid that is judged.
        second: (X, Y, Z), whether it is in the true one.
        grid: where the centers of the voxels are; of unit cells if None.
        placement: of the voxels of the truth's file, of which the grid may be a box, or None.
        connectivity: 6 or 26, that of both solids; the default of the matching if None.
        matching: as for `topokit.compare`.
        tolerance: likewise.
        names: of both.
        resolution: as in `Comparison`.
        notes: likewise.

    Raises:
        InputError: if the shapes differ, or the connectivity is neither 6 nor 26, or not that of the matching.
    """
    if first.shape != second.shape or first.ndim != 3:
        raise InputError(
            f"two solids on one grid (X, Y, Z) were expected, got {first.shape} and {second.shape}: bring them to one "
            "grid first."
        )
    connectivity = connectivity_of(matching, connectivity) or DEFAULT_CONNECTIVITY
    x, y, z = first.shape
    grid = Grid((x, y, z)) if grid is None else grid
    solids = ComparedSolids(
        SolidPair(first, second, connectivity), grid, placement, max(grid.spacing) if tolerance is None else tolerance
    )
    numbers = solids.pair.numbers
    matched = numbers.matched
    if matching == "betti-matching":
        matched, notes = betti_matched(first, second), (*notes, _PLACES)
    betti = numbers.first, numbers.second, matched
    return Comparison(names, solids.pair.connectivity, matching, resolution, *betti, notes, solids)


def connectivity_of(matching: Matching, connectivity: int | None) -> int | None:
    """The connectivity that is asked for, or that of the matching; None if any will do.

    Raises:
        InputError: if there is no such matching, or it has another connectivity.
    """
    if matching not in get_args(Matching):
        raise InputError(f'matching is {matching!r}; "invariant" or "betti-matching" was expected.')
    if matching == "invariant":
        return connectivity
    if connectivity not in (None, 6):
        raise InputError(
            f"Betti matching is defined for 6-connected solids, not for {connectivity}: pass ",
            Option("connectivity", "6"),
            ".",
        )
    return 6


@dataclass(frozen=True, eq=False)
class ComparedSolids:
    """Two solids, from which a comparison takes what costs more than the numbers.

    Attributes:
        pair: the solids.
        grid: where the centers of the voxels are.
        placement: as for `compare_solids`.
        tolerance: distance of surfaces that counts as none.
    """

    pair: SolidPair
    grid: Grid
    placement: Placement | None
    tolerance: float

    def differences(self) -> tuple[Difference, ...]:
        """What only one of them has, with its places."""
        places = Places(self.pair, self.grid.spacing)
        searches = places.parts, lambda side: places.tunnels(side, _MOST_LOOPS), places.cavities
        return tuple(
            _difference(one, self.grid, self.placement)
            for search in searches
            for side in (1, 0)
            for one in search(side)
        )

    @property
    def dice(self) -> float:
        """Of both."""
        return dice(self.pair.first, self.pair.second)

    def agreement(self) -> Agreement:
        """Overlap and surface distance."""
        return agreement(self.pair.first, self.pair.second, self.pair.parts.labels, self.grid.spacing, self.tolerance)


def _difference(found: Found, grid: Grid, placement: Placement | None) -> Difference:
    loop = None if found.loop is None else found.loop * grid.spacing + grid.origin
    bounds, cause = _bounds(found.box, grid), None if found.cause is None else _bounds(found.cause, grid)
    return Difference(
        dimension=found.dimension,
        error="missing" if found.side else "spurious",
        kind=_KINDS[found.side][found.dimension, found.how],
        bounds=bounds,
        volume=None if found.n_voxels is None else float(found.n_voxels * np.prod(grid.spacing)),
        width=found.width,
        loop=loop,
        length=None if loop is None else float(np.linalg.norm(np.roll(loop, -1, 0) - loop, axis=1).sum()),
        cause=cause,
        place=Place.of(middle(cause or bounds), placement),
    )


def _bounds(box: Box, grid: Grid) -> Bounds:
    """Lowest and highest corner of voxels, half a step around their centers."""
    sides = list(zip(box, grid.spacing, grid.origin, strict=True))
    x, y, z = (origin + step * (side.start - 0.5) for side, step, origin in sides)
    u, v, w = (origin + step * (side.stop - 0.5) for side, step, origin in sides)
    return (x, y, z), (u, v, w)
