"""How topology depends on the level: questions to shapes that are made from a field on a grid."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.core.blocks.curve import EulerCurve
    from topokit.shape.shape import Shape


def euler_curve(shape: Shape, levels: ArrayLike | None = None) -> EulerCurve:
    """χ and Betti numbers of the solids {field > t} for every level t, exact, in the shape's connectivity.

    Of a volume the field is its gray values; of a function what it gives on the grid of its field, minus the level and
    positive inside. The shape's own level makes no difference, so a volume whose level is not known yet may be opened
    with any, such as `from_voxels(volume, level=float("-inf"))`.

    Args:
        levels: ascending; None gives all levels at which a number changes, which are many where the field is noise.

    Returns:
        `EulerCurve`: `levels`, `euler` and `betti` (pieces, tunnels, cavities) of the solid; `at` and `range_of`.

    Raises:
        InputError: if the shape has no field (meshes, points, volumes that are counted block by block), or levels are
            not ascending.

    Example:
        >>> import numpy as np, topokit as tk
        >>> ring = np.ones((3, 3, 1))
        >>> ring[1, 1] = 0.2
        >>> curve = tk.from_voxels(ring, level=0).euler_curve()
        >>> curve.betti.tolist(), curve.range_of(0.5)
        ([[1, 1, 0], [0, 0, 0]], (0.2, 1.0))
    """
    if shape.field is None:
        raise InputError(
            f"{shape.name} has no field on a grid in memory; volumes and functions have curves over levels."
        )
    from topokit.core.blocks.curve import euler_curve as curve_of  # loads numba, which other shapes do not need

    curve = curve_of(shape.field.gray_values()[0], shape.field.connectivity)
    return curve if levels is None else curve.at(levels)


def level_range(shape: Shape) -> tuple[float, float] | None:
    """The levels at which the Betti numbers of a shape's solid stay; None if it has no levels."""
    if shape.field is None or shape.field.is_binary:
        return None
    return euler_curve(shape).range_of(shape.field.gray_values()[1])
