"""Locating what a report counts: handles, boundaries and defects of the shape, pieces and cavities of a volume."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Literal, TypeVar

from topokit.core.grid.placement import Placement
from topokit.core.handles.handle import Handle
from topokit.core.loops import middle
from topokit.core.mesh.defects import Defect
from topokit.core.mesh.topology import mesh_topology
from topokit.errors import MissingDependencyError, TopokitError
from topokit.report.location import (
    LocatedBoundary,
    LocatedDefect,
    LocatedHandle,
    LocatedRegion,
    Location,
    Place,
)
from topokit.report.report import TopologyReport
from topokit.shape.surface import closed_surface

if TYPE_CHECKING:
    from topokit.shape.shape import Shape

Found = TypeVar("Found")

_MOST_REGIONS = 1000  # pieces and cavities that are located; `per_component` has all


def with_location(report: TopologyReport, shape: Shape) -> TopologyReport:
    """The report with the places of handles, boundaries, defects, pieces and cavities.

    The location's notes say what cannot be located, such as the handles of an open surface, or self-intersections
    without libigl.
    """
    notes: list[str] = []
    crossings: int | None = None

    def located(what: str, question: Callable[[], Sequence[Found]]) -> Sequence[Found]:
        try:
            return question()
        except TopokitError as error:
            notes.append(f"{what} were not located: {error}")
            return ()

    def defects() -> Sequence[Defect]:
        nonlocal crossings
        try:
            found = shape.defects()
        except MissingDependencyError as error:
            notes.append(f"Self-intersections were not located: {error}")
            return shape.defects(self_intersections=False)
        crossings = sum(one.kind == "self-intersection" for one in found)
        return found

    has_handles, has_mesh = report.closed and report.genus != 0, shape.mesh is not None
    location = Location(
        handles=located_handles(located("Handles", shape.handles) if has_handles else (), report.placement),
        boundaries=tuple(
            LocatedBoundary(one.length, one.closed, middle(one.bounds), one.bounds, one.points)
            for one in (() if report.closed else located("Boundaries", shape.boundaries))
        ),
        defects=tuple(
            LocatedDefect(one.kind, len(one.faces), middle(one.bounds), one.bounds, one.points)
            for one in (located("Defects", defects) if has_mesh else ())
        ),
        notes=tuple(notes),
        regions=tuple(islice(_regions(report), _MOST_REGIONS)),
    )
    return replace(report, location=location, self_intersections=crossings)


def _regions(report: TopologyReport) -> Iterator[LocatedRegion]:
    """The pieces of the solid in a closed surface if there are several, and its cavities, largest surface first."""
    for number, one in enumerate(report.per_component if report.pieces is not None else ()):
        is_cavity = (one.depth or 0) % 2 == 1
        if is_cavity or report.pieces != 1:
            place = None if one.voxel is None else Place.of(one.voxel, report.placement)
            center = middle(one.bounds)
            kind: Literal["piece", "cavity"] = "cavity" if is_cavity else "piece"
            in_file = Place.of(center, report.placement)
            yield LocatedRegion(kind, one.volume, center, one.bounds, number, place, in_file)


def located_handles(handles: Sequence[Handle[Shape]], placement: Placement | None = None) -> tuple[LocatedHandle, ...]:
    """Handles as a report holds them, in a volume with their places in it."""
    return tuple(
        LocatedHandle(
            handle_length=one.handle_length,
            tunnel_length=one.tunnel_length,
            center=one.center,
            bounds=one.bounds,
            component=one.component,
            place=Place.of(one.center, placement),
            handle_loop=one.handle_loop,
            tunnel_loop=one.tunnel_loop,
        )
        for one in handles
    )


def handles(shape: Shape) -> tuple[Handle[Shape], ...]:
    """Where the handles of the closed surface are: for each a handle loop and a tunnel loop, smallest first.

    There are as many as the genus. The loops together form a basis of the first homology; each is shortened to a
    closed geodesic on the triangles of `surface()`. On which side a loop bounds is decided by linking numbers.

    Raises:
        InputError: if there is no closed surface (see `surface`), or it intersects itself.

    Reference:
        Dey, Fan and Wang 2013, DOI 10.1145/2461912.2462017 (handle and tunnel loops).

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import torus_mesh
        >>> [handle] = tk.from_mesh(*torus_mesh(major=1, minor=0.4)).handles()
        >>> round(handle.handle_length, 1), round(handle.tunnel_length, 1)  # 2π · 0.4 and 2π · (1 − 0.4)
        (2.5, 3.8)
    """
    from topokit.core.handles.find import find_handles  # loads numba and SciPy's optimization

    surface, made = closed_surface(shape), partial(pkgutil.resolve_name("topokit.repair.meshes:mesh_like"), shape)
    return tuple(find_handles(surface.vertices, mesh_topology(surface.vertices, surface.faces), made))
