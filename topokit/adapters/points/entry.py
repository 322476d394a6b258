"""How point clouds are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import re
from pathlib import Path

from topokit.inputs.files import head
from topokit.inputs.numpy_header import numpy_kind
from topokit.inputs.ply_header import ply_kind
from topokit.plugins.adapter import Adapter

TEXT = (".xyz", ".txt", ".csv", ".pwn", ".pts", ".asc")
LAS = b"LASF"


def is_cloud(source: Path) -> bool:
    """Whether the content is a cloud: a .ply without faces, NumPy arrays that are no volume, .las or .pcd."""
    start = head(source)
    kinds = ply_kind(start), numpy_kind(source, start)
    return "points" in kinds or start.startswith(LAS) or is_pcd(start)


def is_pcd(start: bytes) -> bool:
    """Whether a file that begins with these bytes is a .pcd; the comment with the format's name may be missing."""
    header = rb"^(VERSION .*\n\s*FIELDS|FIELDS .*\n(.*\n)*?DATA) "
    return start.startswith(b"# .PCD") or re.search(header, start, re.MULTILINE) is not None


POINTS = Adapter(
    name="points",
    description="point clouds, with or without normals",
    suffixes=(*TEXT, ".npy", ".npz", ".ply", ".pcd", ".las", ".laz"),
    can_open=is_cloud,
    types=("trimesh.PointCloud",),
    extra="topokit[formats]",
    suffix_requires=((".pcd", "pypcd4"), (".las", "laspy"), (".laz", "laspy")),
    differentiable=True,
    opener="topokit.adapters.points.adapter:from_points",
)
