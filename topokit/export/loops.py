"""Curves on a surface as files: PLY with edges, or glTF with lines, colored by what they mark."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from topokit.errors import InputError
from topokit.export.picture import LINE_COLORS
from topokit.export.scene import Line
from topokit.inputs.ply import write_ply


class Located(Protocol):
    """What is written: the location of a report, `topokit.report.location.Location`."""

    @property
    def handles(self) -> Sequence[Any]: ...

    @property
    def boundaries(self) -> Sequence[Any]: ...

    @property
    def defects(self) -> Sequence[Any]: ...


def save_loops(location: Located, path: str | os.PathLike[str]) -> int:
    """Write the places of a report as polylines, colored by kind: handles, tunnels, boundaries, defects.

    Args:
        location: of a report, `shape.report(locate=True).location`.
        path: file to write. A `.ply` has the vertices of all curves with their colors, and an element "edge" with
            vertex1, vertex2 and colors; a defect is a vertex without an edge. A `.glb` has a line for every curve and
            no defects.

    Returns:
        Number of curves and defects written.

    Raises:
        InputError: if the file has another suffix, its folder does not exist, or there is nothing to write.
    """
    target = Path(path)
    if target.suffix.lower() not in (".ply", ".glb"):
        raise InputError(f"{target} does not end with .ply or .glb, the formats that curves are written in: rename it.")
    if not target.parent.is_dir():
        raise InputError(f"the folder of {target} does not exist: create it first.")
    is_ply = target.suffix.lower() == ".ply"
    lines = [line for line in lines_at(location) if is_ply or len(line.points) > 1]
    if not lines:
        raise InputError(f"there is no curve to write to {target}: nothing was located.")
    (_write_ply if is_ply else _write_gltf)(target, lines)
    return len(lines)


def lines_at(location: Located) -> Iterator[Line]:
    """The two loops of each handle, the boundaries, and a point for every defect."""
    for number, handle in enumerate(location.handles, 1):
        yield Line("handle", f"handle {number}", handle.handle_loop, closed=True)
        yield Line("tunnel", f"tunnel {number}", handle.tunnel_loop, closed=True)
    for number, boundary in enumerate(location.boundaries, 1):
        yield Line("boundary", f"boundary {number}", boundary.points, closed=boundary.closed)
    for defect in location.defects:
        yield Line("defect", defect.kind, np.array([defect.center]), closed=False)


def _write_ply(path: Path, lines: Sequence[Line]) -> None:
    starts = np.cumsum([0, *(len(line.points) for line in lines)])
    colors = [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.empty(starts[-1], dtype=[(axis, "f8") for axis in "xyz"] + colors)
    pieces = []
    for line, start in zip(lines, starts, strict=False):
        rows = slice(start, start + len(line.points))
        for axis, values in zip("xyz", line.points.T, strict=True):
            vertices[axis][rows] = values
        ends = np.stack((np.arange(len(line.points)), np.arange(1, len(line.points) + 1) % len(line.points)), axis=1)
        ends = ends if line.closed and len(line.points) > 1 else ends[:-1]
        edges = np.empty(len(ends), dtype=[("vertex1", "i4"), ("vertex2", "i4"), *colors])
        edges["vertex1"], edges["vertex2"] = (start + ends).T
        for name, value in zip(("red", "green", "blue"), LINE_COLORS[line.kind], strict=True):
            vertices[name][rows], edges[name] = value, value
        pieces.append(edges)
    write_ply(path, vertex=vertices, edge=np.concatenate(pieces))


def _write_gltf(path: Path, lines: Sequence[Line]) -> None:
    import trimesh

    scene = trimesh.Scene()
    for number, line in enumerate(lines):
        points = np.vstack((line.points, line.points[:1])) if line.closed else line.points
        entity = trimesh.path.entities.Line(np.arange(len(points)), color=(*LINE_COLORS[line.kind], 255))
        scene.add_geometry(trimesh.path.Path3D([entity], points, process=False), geom_name=f"{number + 1} {line.label}")
    scene.export(str(path))
