"""The box in which the surface of a function is looked for."""

from __future__ import annotations

import torch

from topokit.adapters.implicit.function import LevelFunction
from topokit.adapters.implicit.surface import Bounds
from topokit.core.grid.grid import Grid
from topokit.core.implicit.adaptive_grid import dense_field
from topokit.core.implicit.convergence import reached_faces
from topokit.errors import InputError

UNIT_CUBE: Bounds = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
_EXPECTED_BOUNDS = "((x0, y0, z0), (x1, y1, z1)), or (lowest, highest) for a cube"
_SEARCH_CELLS = 32  # of the grids on which bounds are searched
_DOUBLINGS = 6  # from [−1, 1]³ to [−64, 64]³


def as_bounds(bounds: object) -> Bounds:
    """Lowest and highest corner of a box that a caller gave, as such corners or as two numbers."""
    try:
        corners = torch.tensor(bounds, dtype=torch.float64)
        corners = corners[:, None].expand(2, 3) if corners.shape == (2,) else corners
    except (TypeError, ValueError) as error:
        raise InputError(f"bounds could not be read ({error}); expected {_EXPECTED_BOUNDS}.") from error
    if corners.shape != (2, 3) or not bool(corners.isfinite().all()) or not bool((corners[0] < corners[1]).all()):
        raise InputError(f"bounds must be {_EXPECTED_BOUNDS}, with lower before upper, got {bounds}.")
    low, high = (tuple(corner) for corner in corners.tolist())
    return low, high


def find_bounds(function: LevelFunction) -> tuple[Bounds, tuple[str, ...]]:
    """The smallest of the boxes [−2ᵏ, 2ᵏ]³ that holds the surface, else [−1, 1]³; and a note unless it is that one."""
    for side in (float(2**doubling) for doubling in range(_DOUBLINGS + 1)):
        bounds = (-side, -side, -side), (side, side, side)
        values = dense_field(function.without_graph, Grid.covering(*bounds, _SEARCH_CELLS)).values
        touches = any(any(pair) for pair in reached_faces(values))
        if bool((values > 0).any()) and not touches:
            note = f"The surface does not fit into [−1, 1]³; it was looked for in [−{side:g}, {side:g}]³."
            return bounds, (note,) if side > 1 else ()
    return UNIT_CUBE, ()
