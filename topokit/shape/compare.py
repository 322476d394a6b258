"""Two shapes compared as solids on a common grid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from topokit.comparison.result import Comparison, Matching
from topokit.core.arrays import Booleans, Floats
from topokit.core.components import corner
from topokit.core.grid.field import Field
from topokit.core.grid.grid import Grid
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError
from topokit.shape.surface import closed_surface

if TYPE_CHECKING:
    from topokit.shape.shape import Shape

DEFAULT_CELLS = 128  # of the common grid along the longest side of both shapes: seconds, and 2 million voxels at most
_MARGIN = 1.5  # cells between the shapes and the end of the grid; not whole, as coordinates often are
_TENFOLD = 10.0  # ratio of extents above which shapes are hardly in one frame


def compare(
    shape: Shape,
    other: Shape,
    *,
    resolution: int = DEFAULT_CELLS,
    tolerance: float | None = None,
    connectivity: int | None = None,
    matching: Matching = "invariant",
) -> Comparison:
    """Which parts, tunnels and cavities of this solid the other one, the truth, has too; see `topokit.compare`.

    Volumes on the same grid are compared voxel by voxel. All other pairs are compared as the solids inside their closed
    surfaces, on a grid that holds both; features narrower than its step are lost. Nothing is aligned: both must be in
    one frame.

    Args:
        shape: what is judged.
        other: the truth.
        resolution: cells of the common grid along the longest side; not used for volumes on the same grid.
        tolerance: distance of surfaces that counts as none in `agreement`; a step of the grid if None.
        connectivity: 6 or 26, of both solids; that of a volume, or the default of volumes, if None.
        matching: as for `topokit.compare`.

    Raises:
        InputError: if a shape has no closed surface (see `Shape.surface`), or two volumes differ in connectivity.
    """
    # Imported where they are needed: they load numba.
    from topokit.comparison.solids import compare_solids, connectivity_of
    from topokit.core.mesh.rasterized import rasterized

    names, connectivity = (shape.name, other.name), connectivity_of(matching, connectivity)
    mine, theirs = shape.field, other.field
    if mine is not None and theirs is not None and _on_one_grid(mine, theirs):
        if connectivity is None and mine.connectivity != theirs.connectivity:
            raise InputError(
                f"{names[0]} is {mine.connectivity}-connected and {names[1]} {theirs.connectivity}-connected: open "
                "both with one connectivity, or pass connectivity=."
            )
        one, two = ((values > level).cpu().numpy() for values, level in (mine.gray_values(), theirs.gray_values()))
        connectivity = connectivity or mine.connectivity
        placement = None if other.counted is None else other.counted.placement
        return compare_solids(
            one,
            two,
            mine.grid,
            placement=placement,
            connectivity=connectivity,
            matching=matching,
            tolerance=tolerance,
            names=names,
        )
    if not resolution >= 2:
        raise InputError(f"resolution is {resolution!r}; a number of cells, at least 2, was expected.")
    surfaces = closed_surface(shape), closed_surface(other)
    grid = _common_grid(surfaces, resolution)
    first, second = (rasterized(surface, grid) for surface in surfaces)
    found = compare_solids(
        first,
        second,
        grid,
        connectivity=connectivity,
        matching=matching,
        tolerance=tolerance,
        names=names,
        resolution=grid.step,
        notes=tuple(_frame_notes(names, surfaces)),
    )
    notes = (*found.notes, *_lost(shape, found.betti_a, grid), *_lost(other, found.betti_b, grid))
    return found.with_notes(notes)


def _on_one_grid(one: Field, other: Field) -> bool:
    """Whether both are volumes, with their values at the same places."""
    return not (one.is_costly or other.is_costly) and one.grid == other.grid


def _common_grid(surfaces: tuple[TriangleSurface, TriangleSurface], resolution: int) -> Grid:
    corners = np.concatenate([surface.vertices for surface in surfaces])
    low, high = corners.min(0), corners.max(0)
    step = float((high - low).max()) / resolution
    x, y, z = (np.ceil((high - low) / step) + 1 + 2 * _MARGIN).astype(int).tolist()
    return Grid((x, y, z), (step, step, step), corner(low - _MARGIN * step))


def _frame_notes(names: tuple[str, str], surfaces: tuple[TriangleSurface, TriangleSurface]) -> list[str]:
    """A sentence if both are hardly in one frame."""
    boxes: list[tuple[Floats, Floats]] = [(one.vertices.min(0), one.vertices.max(0)) for one in surfaces]
    sides = [float((high - low).max()) for low, high in boxes]
    apart: Booleans = np.maximum(boxes[0][0], boxes[1][0]) > np.minimum(boxes[0][1], boxes[1][1])
    if max(sides) > _TENFOLD * min(sides) or apart.any():
        how = "their boxes do not meet" if apart.any() else f"their extents are {sides[0]:.3g} and {sides[1]:.3g}"
        return [f"{names[0]} and {names[1]} are compared as they lie, without alignment, and {how}."]
    return []


def _lost(shape: Shape, betti: tuple[int, int, int], grid: Grid) -> list[str]:
    """A sentence if the grid does not show the topology of a shape."""
    own = shape.report().solid_betti
    if own is None or own == betti:
        return []
    counts = [", ".join(map(str, numbers)) for numbers in (betti, own)]
    return [
        f"The grid, of step {grid.step:.3g}, shows {shape.name} with {counts[0]} parts, tunnels and cavities; its "
        f"report counts {counts[1]}. Pass a larger resolution than {max(grid.shape)}."
    ]
