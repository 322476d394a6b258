"""Where the topology of a shape is, as marks of a scene and rows of a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from topokit.export.colors import Floats
from topokit.export.scene import Mark

MOST_MARKS = 300  # of each kind, in the order of the report; a scan can have thousands
_MOST_POINTS = 400  # dots of one defect


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


class Located(Protocol):
    """What a report has located."""

    @property
    def handles(self) -> Sequence[LocatedHandle]: ...

    @property
    def boundaries(self) -> Sequence[LocatedBoundary]: ...

    @property
    def defects(self) -> Sequence[LocatedDefect]: ...


def marks_of(located: Located | None) -> tuple[Mark, ...]:
    """Handles, tunnels, boundaries and defects in the order of the table; none for None."""
    if located is None:
        return ()
    marks: list[Mark] = []
    for number, handle in enumerate(located.handles[:MOST_MARKS], start=1):
        marks.append(Mark("handle", f"handle {number}: handle loop", handle.handle_loop, "loop"))
        marks.append(Mark("tunnel", f"handle {number}: tunnel loop", handle.tunnel_loop, "loop"))
    for number, boundary in enumerate(located.boundaries[:MOST_MARKS], start=1):
        marks.append(Mark("boundary", f"boundary {number}", boundary.points, "loop" if boundary.closed else "curve"))
    for defect in located.defects[:MOST_MARKS]:
        step = -(-len(defect.points) // _MOST_POINTS)
        marks.append(Mark("defect", defect.kind, defect.points[::step], "dots"))
    return tuple(marks)
