"""How topology depends on the level: gray values, the distance to a surface, or the radius of balls around points."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from topokit.core.scale.signed_distance import signed_distance, smallest_cell
from topokit.errors import InputError
from topokit.shape.facts import sample_points
from topokit.shape.surface import closed_surface

if TYPE_CHECKING:
    from topokit.core.blocks.curve import EulerCurve
    from topokit.shape.shape import Shape


Levels = ArrayLike | int | None


def euler_curve(shape: Shape, levels: Levels = None, *, resolution: int = 128, betti: bool = True) -> EulerCurve:
    """χ and Betti numbers of a shape's solids at every level t.

    A volume's solids are {gray values > t}, exact, in the shape's connectivity. The shape's own level makes no
    difference, so a volume whose level is not known yet may be opened with any, such as
    `from_voxels(volume, level=float("-inf"))`. A function's solids are {field > t} on the grid of its field, minus the
    level and positive inside.

    A mesh's solids are the points more than t inside the surface, or up to −t outside, on a grid. Distances are wrong
    by up to a cell, so what changes within two cells is rounding.

    Points and splats have the unions of balls with radius t around the samples, from their Delaunay tetrahedra.

    Args:
        levels: ascending; None gives all levels at which a number changes, which are many where the field is noise.
            A number gives at most so many of these, as evenly spaced as they are. Volumes that are counted block by
            block have all levels only if they hold whole numbers of 8 or 16 bits; otherwise a number gives levels
            between the lowest and the highest value, and None is an error.
        resolution: of a mesh, cells along the longest side of its box.
        betti: whether to count Betti numbers. χ alone takes a third of the time in memory where the volume is noisy.

    Returns:
        `EulerCurve`: `levels`, and `euler` and `betti` (pieces, tunnels, cavities; (n, 0) if they were not wanted) of
        the solid; `at` and `range_of`; `over` says what the levels are.

    Raises:
        InputError: if levels are not ascending, a mesh has no closed surface or is thinner than a cell, fewer than 5
            samples are distinct, a volume is periodic, or levels are needed.

    Example:
        >>> import numpy as np, topokit as tk
        >>> ring = np.ones((3, 3, 1))
        >>> ring[1, 1] = 0.2
        >>> curve = tk.from_voxels(ring, level=0).euler_curve()
        >>> curve.betti.tolist(), curve.range_of(0.5)
        ([[1, 1, 0], [0, 0, 0]], (0.2, 1.0))
    """
    # Imported where they are needed: one loads numba, the other SciPy's triangulations.
    from topokit.core.blocks.curve import euler_curve as curve_of_field

    if isinstance(levels, int) and levels < 1:
        raise InputError(f"levels is {levels}; expected a positive number of levels, or an ascending row of them.")
    if shape._curve is not None:
        curve = shape._curve(levels)
        return curve if betti else curve.without_betti()
    if shape.field is not None:
        curve = curve_of_field(shape.field.gray_values()[0], shape.field.connectivity, betti)
    elif shape.mesh is not None:
        curve = replace(curve_of_field(_depth(shape, resolution), betti=betti), over="distance inside the surface")
    else:
        from topokit.core.cloud.solid.union_curve import union_curve

        curve = union_curve(sample_points(shape, "the curve is that"))
        curve = curve if betti else curve.without_betti()
    if levels is None:
        return curve
    return curve.sampled(levels) if isinstance(levels, int) else curve.at(levels)


def _depth(shape: Shape, resolution: int) -> NDArray[np.float32]:
    """Distances inside the closed surface of a mesh, on a grid around its box.

    That the grid ends at the box changes no Betti number: what is near the surface shrinks onto the part of it in the
    box, as the nearest point of a convex set is never farther from a point of the set.
    """
    surface = closed_surface(shape)
    finest = int(np.ptp(surface.vertices, axis=0).max() / smallest_cell(surface))
    if not 0 < resolution <= finest:
        raise InputError(f"resolution is {resolution!r}; expected a positive number of cells, here {finest} at most.")
    distance = signed_distance(surface, float(np.ptp(surface.vertices, axis=0).max()) / resolution)
    if not len(distance.samples):
        raise InputError(f"{shape.name} is thinner than a cell of {distance.cell:.3g} everywhere: raise resolution.")
    return -distance.values


def level_range(shape: Shape) -> tuple[float, float] | None:
    """The levels at which the Betti numbers of a shape's solid stay; None if it has no levels."""
    if shape.field is None or shape.field.is_binary:
        return None
    return euler_curve(shape).range_of(shape.field.gray_values()[1])
