"""Locating what a report counts: handles, boundaries and defects of the shape that it is about."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from topokit.core.handles.handle import Handle
from topokit.core.mesh.defects import Defect
from topokit.errors import MissingDependencyError, TopokitError
from topokit.report.location import LocatedBoundary, LocatedDefect, LocatedHandle, Location, middle
from topokit.report.report import TopologyReport

if TYPE_CHECKING:
    from topokit.shape.shape import Shape

Found = TypeVar("Found")


def with_location(report: TopologyReport, shape: Shape) -> TopologyReport:
    """The report with the places of handles, boundaries and defects.

    The location's notes say what cannot be located, such as the handles of an open surface, or self-intersections
    without libigl.
    """
    notes: list[str] = []

    def located(what: str, question: Callable[[], Sequence[Found]]) -> Sequence[Found]:
        try:
            return question()
        except TopokitError as error:
            notes.append(f"{what} were not located: {error}")
            return ()

    def defects() -> Sequence[Defect]:
        try:
            return shape.defects()
        except MissingDependencyError as error:
            notes.append(f"Self-intersections were not located: {error}")
            return shape.defects(self_intersections=False)

    has_handles, has_mesh = report.closed and report.genus != 0, shape.mesh is not None
    location = Location(
        handles=located_handles(located("Handles", shape.handles) if has_handles else ()),
        boundaries=tuple(
            LocatedBoundary(one.length, one.closed, middle(one.bounds), one.bounds, one.points)
            for one in (() if report.closed else located("Boundaries", shape.boundaries))
        ),
        defects=tuple(
            LocatedDefect(one.kind, len(one.faces), middle(one.bounds), one.bounds, one.points)
            for one in (located("Defects", defects) if has_mesh else ())
        ),
        notes=tuple(notes),
    )
    return replace(report, location=location)


def located_handles(handles: Sequence[Handle]) -> tuple[LocatedHandle, ...]:
    """Handles as a report holds them."""
    return tuple(
        LocatedHandle(
            handle_length=one.handle_length,
            tunnel_length=one.tunnel_length,
            center=middle(one.bounds),
            bounds=one.bounds,
            component=one.component,
            handle_loop=one.handle_loop,
            tunnel_loop=one.tunnel_loop,
        )
        for one in handles
    )
