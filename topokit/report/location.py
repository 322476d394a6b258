"""Where topology is: pieces, tunnels, cavities, handles, boundaries and defects with their sizes and places."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from topokit.core.arrays import Floats
from topokit.core.components import Corner
from topokit.core.grid.placement import Index, Placement
from topokit.core.loops import bounds_of, width_of
from topokit.report.wording import plural, position

Box = tuple[Corner, Corner]

NOT_IN_JSON = {"json": False}
"""Metadata of fields that reports leave out of their JSON: curves may have a million points."""

_MOST_TOLD = 10  # handles and boundaries that the text of a report lists one by one


@dataclass(frozen=True)
class Place:
    """A place in a volume, for a viewer of its file.

    Attributes:
        voxel: index of the nearest voxel.
        world: in the coordinates of the file, or None if it has none.
        unit: of `world` and of all lengths, such as "mm"; empty if unknown.
        space: directions of the axes of `world`, such as "RAS"; empty if unknown.
    """

    voxel: Index
    world: Corner | None
    unit: str
    space: str

    @classmethod
    def of(cls, point: Sequence[float], placement: Placement | None) -> Place | None:
        """That of a point in the coordinates of the shape; None without a placement."""
        if placement is None:
            return None
        return cls(placement.voxel(point), placement.world(point), placement.unit, placement.space)

    @property
    def coordinates(self) -> str:
        """World coordinates with unit and axes; the index of the voxel if the file has none."""
        if self.world is None:
            return f"voxel {self.voxel}"
        return f"{position(self.world, 1.0)} {' '.join(filter(None, (self.unit, self.space))) or 'world'}"

    def __str__(self) -> str:
        return self.coordinates if self.world is None else f"{self.coordinates}, voxel index {self.voxel}"


@dataclass(frozen=True, eq=False)
class LocatedRegion:
    """A piece of the solid in a closed surface, or one of its cavities.

    Attributes:
        kind: which of the two.
        volume: in a volume, of its voxels, in cubed units of length; else None.
        center: middle of its bounding box.
        bounds: lowest and highest corner of the box.
        component: index into the report's `per_component` of the surface around it.
        place: in a volume, of its first voxel, which surely belongs to it.
        middle: in a volume, of `center`, which may lie outside it.
    """

    kind: Literal["piece", "cavity"]
    volume: float | None
    center: Corner
    bounds: Box
    component: int
    place: Place | None
    middle: Place | None


@dataclass(frozen=True, eq=False)
class LocatedHandle:
    """One handle of a closed surface; see `topokit.Handle`.

    Attributes:
        handle_length: length of the loop around the handle, in units of length.
        tunnel_length: length of the loop around the tunnel.
        center: middle of the box around the loop around the tunnel: on its axis where that is straight.
        bounds: lowest and highest corner of the box around both loops.
        component: index into the report's `per_component`.
        place: of `center` in a volume, else None.
        handle_loop: (N, 3), not in JSON.
        tunnel_loop: (M, 3), not in JSON.
    """

    handle_length: float
    tunnel_length: float
    center: Corner
    bounds: Box
    component: int
    place: Place | None
    handle_loop: Floats = field(repr=False, metadata=NOT_IN_JSON)
    tunnel_loop: Floats = field(repr=False, metadata=NOT_IN_JSON)

    def in_file(self, placement: Placement | None) -> LocatedHandle:
        """The handle of a volume in the coordinates of its file, as `place` has them; any other as it is."""
        if placement is None:
            return self
        loops = placement.in_file(self.handle_loop), placement.in_file(self.tunnel_loop)
        x, y, z = placement.in_file(np.array(self.center)).tolist()
        box = bounds_of(np.concatenate(loops))
        return replace(self, center=(x, y, z), bounds=box, handle_loop=loops[0], tunnel_loop=loops[1])


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
        regions: of a closed surface, pieces if there are several and cavities, largest surface first, up to 1000.
    """

    handles: tuple[LocatedHandle, ...]
    boundaries: tuple[LocatedBoundary, ...]
    defects: tuple[LocatedDefect, ...]
    notes: tuple[str, ...]
    regions: tuple[LocatedRegion, ...] = ()

    def lines(self) -> tuple[str, ...]:
        """What the text of a report says: places one by one while they are few, defects by kind."""
        lines = []
        for kind, many in (("piece", "pieces"), ("cavity", "cavities")):
            regions = [one for one in self.regions if one.kind == kind]
            lines += [f"{kind.capitalize()} at {_region_line(one)}." for one in regions[:_MOST_TOLD]]
            lines += _more(len(regions), kind, many)
        lines += map(_handle_line, self.handles[:_MOST_TOLD])
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


def _region_line(one: LocatedRegion) -> str:
    size = "" if one.volume is None else f"volume {one.volume:.4g}{_unit(one.place, '³')}, "
    if one.place is None or one.middle is None:
        sides = " × ".join(f"{high - low:.3g}" for low, high in zip(*one.bounds, strict=True))
        return f"{_at(one.center, one.bounds)}: {size}{sides} large"
    return f"{one.place}: {size}middle of its box {one.middle.coordinates}"


def _handle_line(one: LocatedHandle) -> str:
    unit = _unit(one.place)
    lengths = f"{one.handle_length:.4g}{unit} around the handle, {one.tunnel_length:.4g}{unit} around the tunnel."
    return f"Tunnel at {_at(one.center, one.bounds) if one.place is None else one.place}: {lengths}"


def _unit(place: Place | None, power: str = "") -> str:
    return f" {place.unit}{power}" if place is not None and place.unit else ""


def _at(center: Corner, bounds: Box) -> str:
    return position(center, width_of(bounds))


def _more(count: int, one: str, many: str) -> list[str]:
    rest = count - _MOST_TOLD
    return [f"{rest} more {one if rest == 1 else many}."] if rest > 0 else []
