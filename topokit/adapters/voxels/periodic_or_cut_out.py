"""Volumes whose ends are no ends: cells of a lattice, and boxes cut out of a larger body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import prod
from typing import Any, Literal, NoReturn, get_args

from topokit.core.arrays import Integers
from topokit.core.blocks.part import Periodic
from topokit.core.blocks.periodic import PeriodicSolid
from topokit.core.components import CountedComponents
from topokit.core.grid.euler import dual_connectivity
from topokit.core.grid.grid import Grid
from topokit.core.grid.minkowski import minkowski_numbers
from topokit.core.grid.placement import Placement
from topokit.errors import InputError, NoSamplesError
from topokit.report.counted import CountedAnswer
from topokit.report.report import Evidence
from topokit.report.verdict import volume_verdict
from topokit.report.wording import plural
from topokit.shape import Shape

Edges = Literal["solid", "cut-out"]


@dataclass(frozen=True)
class Ends:
    """What there is at the ends of a volume.

    Attributes:
        periodic: along which axes the last layer touches the first.
        edges: see `from_voxels`.
    """

    periodic: Periodic = (False, False, False)
    edges: Edges = "solid"

    @classmethod
    def of(cls, periodic: Any, edges: Any) -> Ends:
        """What the arguments of `from_voxels` say, or an `InputError`."""
        axes = (periodic,) * 3 if isinstance(periodic, bool) else tuple(periodic)
        if len(axes) != 3 or not all(isinstance(axis, bool) for axis in axes):
            raise InputError(f"periodic must be True, False or three of these, got {periodic!r}.")
        if edges not in get_args(Edges):
            raise InputError(f'edges must be "solid" or "cut-out", got {edges!r}.')
        if any(axes) and edges == "cut-out":
            raise InputError("a volume is either periodic or cut out of a larger body.")
        return cls((axes[0], axes[1], axes[2]), edges)

    @property
    def is_periodic(self) -> bool:
        """Whether any axis is periodic."""
        return any(self.periodic)


def periodic_shape(name: str, count: Callable[[], CountedAnswer], notes: tuple[str, ...] = ()) -> Shape:
    """The shape of a volume that is periodic along some axes, given how it is counted; it has a report only."""

    def refuse() -> NoReturn:
        raise NoSamplesError(f"{name} is periodic, so it has a report, but no samples and no surface.")

    return Shape(refuse, count, surface=refuse, name=name, notes=notes)


def periodic_answer(
    found: PeriodicSolid,
    connectivity: int,
    periodic: Periodic,
    placement: Placement,
    seconds: float,
    notes: tuple[str, ...] = (),
) -> CountedAnswer:
    """The answer of a volume that is periodic along some axes.

    Args:
        found: what was counted.
        connectivity: 6 or 26, that of the solid.
        periodic: along which axes the last layer touches the first.
        placement: where the voxels are.
        seconds: time the count took.
        notes: sentences about the values.
    """
    along = " and ".join(str(axis) for axis in range(3) if periodic[axis])
    minkowski = minkowski_numbers(found.cubes, connectivity, placement.spacing)
    n_inside = round(minkowski.volume / prod(placement.spacing))
    reason = (
        f"Exact with {connectivity}-connected foreground and {dual_connectivity(connectivity)}-connected background, "
        f"periodic along axis {along}: {plural(n_inside, 'voxel')} with χ = {found.euler}, bounded by "
        f"{plural(found.n_surfaces, 'closed surface')} of genus {found.genus} in all. Loops around the box are "
        "tunnels, and sheets across it add cavities."
    )
    return CountedAnswer(
        evidence=Evidence("count of cells in a periodic box", 2.0 * found.euler, 2 * found.euler, seconds),
        components=CountedComponents.none(),
        closed=True,
        boundary_loops=0,
        verdict=volume_verdict(),
        reasons=(reason, *notes),
        placement=placement,
        torus=found,
        minkowski=minkowski,
    )


def cut_out_answer(answer: CountedAnswer, cubes: Integers, connectivity: int, grid: Grid) -> CountedAnswer:
    """The answer with what the volume contributes to χ of the solid that it was cut from.

    Args:
        answer: of the volume as a solid of its own.
        cubes: (256,) of the volume without background around it; see `cube_counts`.
        connectivity: 6 or 26, that of the solid.
        grid: of the volume.
    """
    found = minkowski_numbers(cubes, connectivity, grid.spacing)
    sides = [(n - 1) * step for n, step in zip(grid.shape, grid.spacing, strict=True)]
    if not prod(sides):
        raise InputError(f"a box of shape {grid.shape} cut from a larger body needs two layers along each axis.")
    density = (1 - found.euler) / prod(sides)
    reason = (
        f"As a box cut from a larger body it contributes Δχ = {found.euler:g} to χ of the solid: a connectivity "
        f"density of {density:.4g} in a cubed unit of length."
    )
    first, *others = answer.reasons
    return replace(
        answer,
        reasons=(first, reason, *others),
        cut_out_euler=found.euler,
        connectivity_density=density,
        minkowski=found,
    )
