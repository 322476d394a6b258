"""The header of a .ply file: whether it announces a mesh, points or Gaussian splats."""

from __future__ import annotations

import re
from typing import Literal


def ply_kind(beginning: bytes) -> Literal["mesh", "points", "splats"] | None:
    """What the header of a .ply file announces; None if the file is no .ply."""
    if not beginning.startswith(b"ply"):
        return None
    properties = ply_properties(beginning)
    if b"packed_position" in properties or {b"scale_0", b"scale_1", b"rot_3"} <= properties:
        return "splats"
    faces = re.search(rb"element\s+(?:face|tristrips)\s+(\d+)", beginning.partition(b"end_header")[0])
    return "mesh" if faces and int(faces.group(1)) > 0 else "points"


def ply_properties(beginning: bytes) -> set[bytes]:
    """Names of the scalar properties in the header of a .ply file."""
    header = beginning.partition(b"end_header")[0]
    return set(re.findall(rb"^property\s+\w+\s+(\w+)\s*$", header, re.MULTILINE))
