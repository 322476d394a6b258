"""Locating what a report counts: handles, boundaries and defects of the shape that it is about."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from topokit.core.components import Corner
from topokit.core.loops import BoundaryLoop
from topokit.core.mesh.defects import Defect
from topokit.errors import MissingDependencyError, TopokitError
from topokit.report.location import LocatedBoundary, LocatedDefect, LocatedHandle, Location, middle
from topokit.report.report import TopologyReport

Found = TypeVar("Found")


class Handle(Protocol):
    """A handle with its two loops: a `topokit.Handle`."""

    @property
    def handle_loop(self) -> NDArray[np.float64]: ...
    @property
    def tunnel_loop(self) -> NDArray[np.float64]: ...
    @property
    def handle_length(self) -> float: ...
    @property
    def tunnel_length(self) -> float: ...
    @property
    def bounds(self) -> tuple[Corner, Corner]: ...
    @property
    def component(self) -> int: ...


class Locatable(Protocol):
    """What is asked for its places: a `topokit.Shape`."""

    @property
    def mesh(self) -> tuple[Tensor, Tensor] | None: ...

    def handles(self) -> Sequence[Handle]: ...

    def boundaries(self) -> Sequence[BoundaryLoop]: ...

    def defects(self, *, self_intersections: bool = True) -> Sequence[Defect]: ...


def with_location(report: TopologyReport, shape: Locatable) -> TopologyReport:
    """The report with the places of handles, boundaries and defects.

    What cannot be located, such as the handles of an open surface or self-intersections without libigl, is told in the
    location's notes.
    """
    notes: list[str] = []

    def asked(what: str, question: Callable[[], Sequence[Found]]) -> Sequence[Found]:
        try:
            return question()
        except TopokitError as error:
            notes.append(f"{what} were not located: {error}")
            return ()

    def all_defects() -> Sequence[Defect]:
        try:
            return shape.defects()
        except MissingDependencyError as error:
            notes.append(f"Self-intersections were not located: {error}")
            return shape.defects(self_intersections=False)

    handles: Sequence[Handle] = ()
    if report.closed and report.genus != 0:
        handles = asked("Handles", shape.handles)
    boundaries: Sequence[BoundaryLoop] = () if report.closed else asked("Boundaries", shape.boundaries)
    defects: Sequence[Defect] = () if shape.mesh is None else asked("Defects", all_defects)
    location = Location(
        handles=located_handles(handles),
        boundaries=tuple(
            LocatedBoundary(one.length, one.closed, middle(one.bounds), one.bounds, one.points) for one in boundaries
        ),
        defects=tuple(
            LocatedDefect(one.kind, len(one.faces), middle(one.bounds), one.bounds, one.points) for one in defects
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
