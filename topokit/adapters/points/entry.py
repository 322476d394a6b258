"""How point clouds are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import re
from pathlib import Path

from topokit.inputs.files import head
from topokit.inputs.numpy_header import numpy_kind
from topokit.inputs.ply_header import ply_kind
from topokit.inputs.unpacking import unpacked
from topokit.plugins.adapter import Adapter

TEXT = (".xyz", ".txt", ".csv", ".pwn", ".pts", ".asc")
LAS = b"LASF"
E57 = b"ASTM-E57"


def is_cloud(source: Path) -> bool:
    """Whether the content is a cloud: a .ply or .obj without faces, NumPy arrays that are no volume, .las or .pcd."""
    start = head(source)
    if source.name.lower().endswith((".obj", ".obj.gz")):
        return is_obj_cloud(source)
    kinds = ply_kind(start), numpy_kind(source, start)
    return "points" in kinds or start.startswith((LAS, E57)) or is_pcd(start)


def is_obj_cloud(path: Path) -> bool:
    """Whether a file called .obj has vertices and no faces, which only its end tells."""
    has_vertex = False
    with unpacked(path) as plain, plain.open("rb") as file:
        for line in file:
            start = line[:4].lstrip()[:2]
            if start in (b"f ", b"f\t"):
                return False
            has_vertex = has_vertex or start == b"v "
    return has_vertex


def is_pcd(start: bytes) -> bool:
    """Whether a file that begins with these bytes is a .pcd; the comment with the format's name may be missing."""
    header = rb"^(VERSION .*\n\s*FIELDS|FIELDS .*\n(.*\n)*?DATA) "
    return start.startswith(b"# .PCD") or re.search(header, start, re.MULTILINE) is not None


POINTS = Adapter(
    name="points",
    description="point clouds, with or without normals",
    suffixes=(*TEXT, ".npy", ".npz", ".ply", ".pcd", ".las", ".laz", ".e57"),
    can_open=is_cloud,
    types=(
        *("trimesh.PointCloud", "pandas.DataFrame", "polars.DataFrame"),
        *("pytorch3d.structures.Pointclouds", "pyvista.PointSet", "vedo.Points"),
    ),
    extra="topokit[formats]",
    suffix_requires=((".pcd", "pypcd4"), (".las", "laspy"), (".laz", "laspy"), (".e57", "pye57")),
    differentiable=True,
    opener="topokit.adapters.points.adapter:from_points",
)
