"""Curves on a surface as files: PLY with edges, or glTF with lines, colored by what they mark."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from topokit.errors import InputError
from topokit.export.colors import Floats
from topokit.export.picture import MARK_COLORS
from topokit.export.scene import MarkKind
from topokit.inputs.ply import write_ply
from topokit.inputs.writing import completed_file

Curve = tuple[MarkKind, str, Floats, bool | None]
"""What it marks, its name, its points, and whether it is closed; None for points that are not joined."""


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
            vertex1, vertex2 and colors; defects are vertices without an edge. A `.glb` has a line for every curve and
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
    curves = list(_curves(location))
    if target.suffix.lower() == ".ply":
        curves += [("defect", defect.kind, defect.points, None) for defect in location.defects]
    if not curves:
        raise InputError(f"there is no curve to write to {target}: nothing was located.")
    with completed_file(target) as unfinished:
        (_write_ply if target.suffix.lower() == ".ply" else _write_gltf)(unfinished, curves)
    return len(curves)


def _curves(location: Located) -> Iterator[Curve]:
    for number, handle in enumerate(location.handles, 1):
        yield "handle", f"handle {number}: handle loop", handle.handle_loop, True
        yield "tunnel", f"handle {number}: tunnel loop", handle.tunnel_loop, True
    for number, boundary in enumerate(location.boundaries, 1):
        yield "boundary", f"boundary {number}", boundary.points, boundary.closed


def _write_ply(path: Path, curves: Sequence[Curve]) -> None:
    colors = [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.empty(sum(len(points) for _, _, points, _ in curves), [(axis, "f8") for axis in "xyz"] + colors)
    pieces, start = [], 0
    for kind, _, points, closed in curves:
        index = start + np.arange(len(points))
        for axis, values in zip("xyz", points.T, strict=True):
            vertices[axis][index] = values
        n_edges = 0 if closed is None else len(points) - (not closed)
        edges = np.empty(n_edges, [("vertex1", "i4"), ("vertex2", "i4"), *colors])
        edges["vertex1"], edges["vertex2"] = index[:n_edges], np.roll(index, -1)[:n_edges]
        for name, value in zip(("red", "green", "blue"), MARK_COLORS[kind], strict=True):
            vertices[name][index], edges[name] = value, value
        pieces.append(edges)
        start += len(points)
    write_ply(path, vertex=vertices, edge=np.concatenate(pieces))


def _write_gltf(path: Path, curves: Sequence[Curve]) -> None:
    import trimesh

    scene = trimesh.Scene()
    for kind, label, points, closed in curves:
        corners = np.vstack((points, points[:1])) if closed else points
        entity = trimesh.path.entities.Line(np.arange(len(corners)), color=(*MARK_COLORS[kind], 255))
        scene.add_geometry(trimesh.path.Path3D([entity], corners, process=False), geom_name=label)
    scene.export(str(path))
