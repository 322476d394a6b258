"""How point clouds are recognised, without importing what reads them."""

from __future__ import annotations

import re
from pathlib import Path

from topokit.inputs.files import head, numpy_kind, ply_kind
from topokit.plugins.adapter import Adapter

TEXT = (".xyz", ".txt", ".csv", ".pwn", ".pts", ".asc")
LAS = b"LASF"


class Points(Adapter):
    """Point clouds; see `topokit.from_points`."""

    name = "points"
    description = "point clouds, with or without normals"
    suffixes = (*TEXT, ".npy", ".npz", ".ply", ".pcd", ".las", ".laz")
    types = ("trimesh.PointCloud",)
    extra = "topokit[formats]"
    suffix_requires = ((".pcd", "pypcd4"), (".las", "laspy"), (".laz", "laspy"))
    differentiable = True
    opener = "topokit.adapters.points.adapter:from_points"

    def can_open(self, source: Path) -> bool:
        start = head(source)
        kinds = ply_kind(start), numpy_kind(source, start)
        return "points" in kinds or start.startswith(LAS) or is_pcd(start)


def is_pcd(start: bytes) -> bool:
    """Whether a file that begins so is a .pcd; the comment with the format's name may be missing."""
    header = rb"^(VERSION .*\n\s*FIELDS|FIELDS .*\n(.*\n)*?DATA) "
    return start.startswith(b"# .PCD") or re.search(header, start, re.MULTILINE) is not None
