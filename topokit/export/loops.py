"""Curves on a surface as files: PLY with edges, or glTF with lines, colored by what they mark."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from topokit.errors import InputError
from topokit.export.picture import MARK_COLORS
from topokit.export.scene import Mark, marks_of
from topokit.inputs.ply import write_ply
from topokit.inputs.writing import completed_file

if TYPE_CHECKING:
    from topokit.report.location import Location


def save_loops(location: Location, path: str | os.PathLike[str]) -> int:
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
    is_ply = target.suffix.lower() == ".ply"
    curves = [mark for mark in marks_of(location, None) if is_ply or mark.form != "dots"]
    if not curves:
        raise InputError(f"there is no curve to write to {target}: nothing was located.")
    with completed_file(target) as unfinished:
        (_write_ply if is_ply else _write_gltf)(unfinished, curves)
    return len(curves)


def _write_ply(path: Path, curves: Sequence[Mark]) -> None:
    colors = [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.empty(sum(len(curve.points) for curve in curves), [(axis, "f8") for axis in "xyz"] + colors)
    pieces, start = [], 0
    for curve in curves:
        count = len(curve.points)
        index = start + np.arange(count)
        for axis, values in zip("xyz", curve.points.T, strict=True):
            vertices[axis][index] = values
        n_edges = 0 if curve.form == "dots" else count - (curve.form == "curve")
        edges = np.empty(n_edges, [("vertex1", "i4"), ("vertex2", "i4"), *colors])
        edges["vertex1"], edges["vertex2"] = index[:n_edges], np.roll(index, -1)[:n_edges]
        for name, value in zip(("red", "green", "blue"), MARK_COLORS[curve.kind], strict=True):
            vertices[name][index], edges[name] = value, value
        pieces.append(edges)
        start += count
    write_ply(path, vertex=vertices, edge=np.concatenate(pieces))


def _write_gltf(path: Path, curves: Sequence[Mark]) -> None:
    import trimesh

    scene = trimesh.Scene()
    for curve in curves:
        corners = np.vstack((curve.points, curve.points[:1])) if curve.form == "loop" else curve.points
        entity = trimesh.path.entities.Line(np.arange(len(corners)), color=(*MARK_COLORS[curve.kind], 255))
        scene.add_geometry(trimesh.path.Path3D([entity], corners, process=False), geom_name=curve.label)
    scene.export(str(path))
