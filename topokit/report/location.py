"""Where the topology of a surface is: its handles, boundaries and defects with their sizes and places."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from topokit.core.arrays import Floats
from topokit.core.components import Corner
from topokit.report.wording import plural, position

Box = tuple[Corner, Corner]

NOT_IN_JSON = {"json": False}
"""Metadata of fields that reports leave out of their JSON: curves may have a million points."""

_MOST_TOLD = 10  # handles and boundaries that the text of a report lists one by one


@dataclass(frozen=True, eq=False)
class LocatedHandle:
    """One handle of a closed surface; see `topokit.Handle`.

    Attributes:
        handle_length: length of the loop around the handle, in units of length.
        tunnel_length: length of the loop around the tunnel.
        center: middle of the bounding box of both loops.
        bounds: its lowest and highest corner.
        component: index into the report's `per_component`.
        handle_loop: (N, 3), not in JSON.
        tunnel_loop: (M, 3), not in JSON.
    """

    handle_length: float
    tunnel_length: float
    center: Corner
    bounds: Box
    component: int
    handle_loop: Floats = field(repr=False, metadata=NOT_IN_JSON)
    tunnel_loop: Floats = field(repr=False, metadata=NOT_IN_JSON)


@dataclass(frozen=True, eq=False)
class LocatedBoundary:
    """One curve along which a surface ends.

    Attributes:
        length: its length, in units of length.
        closed: False for a curve that ends at non-manifold edges.
        center: middle of its bounding box.
        bounds: lowest and highest corner of the box.
        points: (N, 3), not in JSON.
    """

    length: float
    closed: bool
    center: Corner
    bounds: Box
    points: Floats = field(repr=False, metadata=NOT_IN_JSON)


@dataclass(frozen=True, eq=False)
class LocatedDefect:
    """One fault of a mesh at one place; see `topokit.core.mesh.defects.Defect`.

    Attributes:
        kind: what is wrong.
        faces: number of faces concerned.
        center: middle of the bounding box.
        bounds: lowest and highest corner of the box.
        points: (N, 3), not in JSON.
    """

    kind: str
    faces: int
    center: Corner
    bounds: Box
    points: Floats = field(repr=False, metadata=NOT_IN_JSON)


@dataclass(frozen=True, eq=False)
class Location:
    """Where the topology of a surface is.

    Attributes:
        handles: smallest first; empty where the surface has none, or they could not be located.
        boundaries: longest first.
        defects: of a mesh.
        notes: sentences about what could not be located, and why.
    """

    handles: tuple[LocatedHandle, ...]
    boundaries: tuple[LocatedBoundary, ...]
    defects: tuple[LocatedDefect, ...]
    notes: tuple[str, ...]

    def lines(self) -> tuple[str, ...]:
        """What the text of a report says: handles and boundaries one by one while they are few, defects by kind."""
        lines = [
            f"Handle at {_at(one.center, one.bounds)}: {one.handle_length:.4g} around the handle, "
            f"{one.tunnel_length:.4g} around the tunnel."
            for one in self.handles[:_MOST_TOLD]
        ]
        lines += _more(len(self.handles), "handle", "handles")
        lines += [
            f"Boundary at {_at(one.center, one.bounds)}: {one.length:.4g} long." for one in self.boundaries[:_MOST_TOLD]
        ]
        lines += _more(len(self.boundaries), "boundary", "boundaries")
        for kind, count in Counter(defect.kind for defect in self.defects).items():
            first = next(defect for defect in self.defects if defect.kind == kind)
            lines.append(
                f"Defects, {kind}: at {plural(count, 'place')}, the largest with {plural(first.faces, 'face')} at "
                f"{_at(first.center, first.bounds)}."
            )
        return (*lines, *self.notes)


def middle(bounds: Box) -> Corner:
    """Middle of a box."""
    x, y, z = ((a + b) / 2 for a, b in zip(*bounds, strict=True))
    return x, y, z


def _at(center: Corner, bounds: Box) -> str:
    return position(center, max(b - a for a, b in zip(*bounds, strict=True)))


def _more(count: int, one: str, many: str) -> list[str]:
    rest = count - _MOST_TOLD
    return [f"{rest} more {one if rest == 1 else many}."] if rest > 0 else []
