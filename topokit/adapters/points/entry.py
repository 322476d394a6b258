"""The formats of point clouds, and how they are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import re
from functools import partial
from mmap import ACCESS_READ, mmap
from pathlib import Path

from topokit.inputs.files import BEGINNINGS, ZIP
from topokit.inputs.formats import Format, begins, called, is_certainly, never, requirements_of, suffixes_of
from topokit.inputs.headers import numpy_kind, ply_kind
from topokit.inputs.unpacking import unpacked
from topokit.plugins.adapter import Adapter

TEXT = (".xyz", ".txt", ".csv", ".pwn", ".pts", ".asc")
_PROSE = (".txt", ".csv")
_END = 1 << 16  # bytes
_LINES = {letter: re.compile(rb"\n[ \t]*%s[ \t]" % letter) for letter in (b"v", b"f")}  # all but the first line


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


def _are_points(path: Path, beginning: bytes) -> bool:
    """Whether NumPy's arrays are no volume."""
    return numpy_kind(path, beginning) == "points"


_HERE = "topokit.adapters.points"
FORMATS = (
    Format(
        *("PLY", (".ply",), begins(b"ply"), f"{_HERE}.files:read_ply", f"{_HERE}.files:ply_cloud"),
        is_certain=lambda path, beginning: ply_kind(beginning) == "points",
    ),
    Format("LAS", (".las", ".laz"), begins(b"LASF"), stored=f"{_HERE}.las:LasCloud", requires=("laspy",)),
    Format("parquet", (".parquet",), begins(b"PAR1"), stored=f"{_HERE}.parquet:ParquetCloud", requires=("pyarrow",)),
    Format(
        *("NPY", (".npy",), begins(BEGINNINGS[".npy"]), f"{_HERE}.files:read_npy", f"{_HERE}.files:npy_cloud"),
        is_certain=_are_points,
    ),
    Format("NPZ", (".npz",), begins(ZIP), f"{_HERE}.files:read_npz", is_certain=_are_points),
    Format("PCD", (".pcd",), lambda path, start: is_pcd(start), f"{_HERE}.files:read_pcd", requires=("pypcd4",)),
    Format("E57", (".e57",), begins(b"ASTM-E57"), f"{_HERE}.files:read_e57", requires=("pye57",)),
    Format(
        *("OBJ", (), called(".obj"), f"{_HERE}.files:read_obj"),  # the suffix is that of meshes
        is_certain=lambda path, beginning: is_obj_cloud(path),
    ),
    Format(
        *("text", TEXT, called(*TEXT), f"{_HERE}.text:read_text", f"{_HERE}.text:text_cloud"),
        is_certain=never,
    ),
)

POINTS = Adapter(
    name="points",
    description="point clouds, with or without normals",
    suffixes=suffixes_of(FORMATS),
    can_open=partial(is_certainly, FORMATS),
    types=(
        *("trimesh.PointCloud", "pandas.DataFrame", "polars.DataFrame"),
        *("pytorch3d.structures.Pointclouds", "pyvista.PointSet", "vedo.Points"),
    ),
    extra="topokit[formats]",
    suffix_requires=requirements_of(FORMATS),
    differentiable=True,
    opener="topokit.adapters.points.adapter:from_points",
    is_large="topokit.adapters.points.larger_than_memory:is_large",
    may_open=may_be_points,
)
