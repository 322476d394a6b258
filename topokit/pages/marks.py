"""Where the topology of a shape is, as marks of a scene and rows of a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

from topokit.errors import InputError, MissingDependencyError
from topokit.export.colors import Floats
from topokit.export.scene import Mark

MOST_MARKS = 300  # of each kind, in the order of the report; a scan can have thousands
_MOST_POINTS = 400  # dots of one defect

Found = TypeVar("Found")


class LocatedHandle(Protocol):
    """A `topokit.Handle`."""

    @property
    def handle_loop(self) -> Floats: ...

    @property
    def tunnel_loop(self) -> Floats: ...


class LocatedBoundary(Protocol):
    """A boundary loop."""

    @property
    def points(self) -> Floats: ...

    @property
    def closed(self) -> bool: ...


class LocatedDefect(Protocol):
    """A fault of a mesh."""

    @property
    def kind(self) -> str: ...

    @property
    def points(self) -> Floats: ...


class Locatable(Protocol):
    """What can tell where things are: a `topokit.Shape`."""

    def handles(self) -> Sequence[LocatedHandle]: ...

    def boundaries(self) -> Sequence[LocatedBoundary]: ...

    def defects(self, *, self_intersections: bool = True) -> Sequence[LocatedDefect]: ...


def marks_of(shape: Locatable) -> tuple[Mark, ...]:
    """Handles, tunnels, boundaries and defects of a shape in the order of the table, as far as it has any.

    A shape without a closed surface has no handles that can be located, and one without a mesh no defects.
    """
    return (
        *_handle_marks(_or_none(shape.handles)),
        *_boundary_marks(_or_none(shape.boundaries)),
        *_defect_marks(_or_none(lambda: _defects(shape))),
    )


def _or_none(question: Callable[[], Sequence[Found]]) -> Sequence[Found]:
    """The answer, cut off at the most that is shown; nothing where the question has no meaning for the shape."""
    try:
        return question()[:MOST_MARKS]
    except InputError:
        return ()


def _defects(shape: Locatable) -> Sequence[LocatedDefect]:
    """All defects; without libigl those that need no search for self-intersections."""
    try:
        return shape.defects()
    except MissingDependencyError:
        return shape.defects(self_intersections=False)


def _handle_marks(handles: Sequence[LocatedHandle]) -> Iterator[Mark]:
    for number, handle in enumerate(handles, start=1):
        yield Mark("handle", f"handle {number}: handle loop", handle.handle_loop, "loop")
        yield Mark("tunnel", f"handle {number}: tunnel loop", handle.tunnel_loop, "loop")


def _boundary_marks(boundaries: Sequence[LocatedBoundary]) -> Iterator[Mark]:
    for number, boundary in enumerate(boundaries, start=1):
        yield Mark("boundary", f"boundary {number}", boundary.points, "loop" if boundary.closed else "curve")


def _defect_marks(defects: Sequence[LocatedDefect]) -> Iterator[Mark]:
    for defect in defects:
        step = -(-len(defect.points) // _MOST_POINTS)
        yield Mark("defect", defect.kind, defect.points[::step], "dots")
