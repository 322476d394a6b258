"""How point clouds are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import re
from mmap import ACCESS_READ, mmap
from pathlib import Path

from topokit.inputs.files import head
from topokit.inputs.numpy_header import numpy_kind
from topokit.inputs.ply_header import ply_kind
from topokit.inputs.unpacking import unpacked
from topokit.plugins.adapter import Adapter

TEXT = (".xyz", ".txt", ".csv", ".pwn", ".pts", ".asc")
_PROSE = (".txt", ".csv")
LAS = b"LASF"
E57 = b"ASTM-E57"
PARQUET = b"PAR1"
_END = 1 << 16  # bytes
_LINES = {letter: re.compile(rb"\n[ \t]*%s[ \t]" % letter) for letter in (b"v", b"f")}  # all but the first line


def is_cloud(source: Path) -> bool:
    """Whether the content is a cloud: .ply or .obj without faces, arrays that are no volume, .las, .pcd, .parquet."""
    start = head(source)
    if source.name.lower().endswith((".obj", ".obj.gz")):
        return is_obj_cloud(source)
    kinds = ply_kind(start), numpy_kind(source, start)
    return "points" in kinds or start.startswith((LAS, E57, PARQUET)) or is_pcd(start)


def is_obj_cloud(path: Path) -> bool:
    """Whether a file called .obj has vertices and no faces, which only its end tells."""
    with unpacked(path) as plain, plain.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        if re.search(_LINES[b"f"], content[-_END:]):  # nearly all files with faces end with some
            return False
        return _has_line(content, b"v") and not _has_line(content, b"f")


def _has_line(content: mmap, letter: bytes) -> bool:
    """Whether a line begins with this letter alone."""
    return content[:4].lstrip()[:2].replace(b"\t", b" ") == letter + b" " or bool(re.search(_LINES[letter], content))


def may_be_points(path: Path) -> bool:
    """Whether a file with one of the suffixes may be a cloud: notes and tables have some of them, too."""
    if path.suffix.lower() not in _PROSE:
        return True
    from topokit.adapters.points.text import holds_rows  # imports NumPy, which the command line does without

    return holds_rows(path)


def is_pcd(start: bytes) -> bool:
    """Whether a file that begins with these bytes is a .pcd; the comment with the format's name may be missing."""
    header = rb"^(VERSION .*\n\s*FIELDS|FIELDS .*\n(.*\n)*?DATA) "
    return start.startswith(b"# .PCD") or re.search(header, start, re.MULTILINE) is not None


POINTS = Adapter(
    name="points",
    description="point clouds, with or without normals",
    suffixes=(*TEXT, ".npy", ".npz", ".ply", ".pcd", ".las", ".laz", ".e57", ".parquet"),
    can_open=is_cloud,
    types=(
        *("trimesh.PointCloud", "pandas.DataFrame", "polars.DataFrame"),
        *("pytorch3d.structures.Pointclouds", "pyvista.PointSet", "vedo.Points"),
    ),
    extra="topokit[formats]",
    suffix_requires=(
        (".pcd", "pypcd4"),
        (".las", "laspy"),
        (".laz", "laspy"),
        (".e57", "pye57"),
        (".parquet", "pyarrow"),
    ),
    differentiable=True,
    opener="topokit.adapters.points.adapter:from_points",
    is_large="topokit.adapters.points.large:is_large",
    may_open=may_be_points,
)
