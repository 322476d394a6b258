"""The formats of triangle meshes, and how they are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from topokit.inputs.files import ZIP
from topokit.inputs.formats import Format, begins, is_certainly, never, requirements_of, suffixes_of
from topokit.inputs.headers import ply_kind
from topokit.plugins.adapter import Adapter

# Suffixes of finite-element files, and the modules of meshio that read them.
FINITE_ELEMENTS = {
    ".vtk": "vtk",
    ".vtu": "vtu",
    ".msh": "gmsh",
    ".inp": "abaqus",
    ".mesh": "medit",
    ".bdf": "nastran",
    ".nas": "nastran",
    ".vol": "netgen",
    ".su2": "su2",
    ".f3grid": "flac3d",
    ".ugrid": "ugrid",
}

FREESURFER_START = b"\xff\xff\xfe"
"""How a surface of triangles of FreeSurfer begins."""

_FREESURFER = (".white", ".pial", ".smoothwm", ".inflated", ".sphere")  # lh.white, rh.pial, …


def _may_be_off(path: Path, start: bytes) -> bool:
    """Whether a file begins with one of the words of OFF, perhaps in small letters."""
    return re.match(rb"\s*(ST)?C?N?4?n?OFF", start, re.IGNORECASE) is not None


def _is_off(path: Path, start: bytes) -> bool:
    return re.match(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b", start) is not None


def _is_ply(path: Path, start: bytes) -> bool:
    return ply_kind(start) == "mesh"


def _is_3mf(path: Path, start: bytes) -> bool:
    """Whether an archive is one of those of office programs and 3MF."""
    return b"3D/" in start or b"[Content_Types].xml" in start


_HERE = "topokit.adapters.mesh.files"
_BRAIN = "topokit.adapters.mesh.formats.brain"
FORMATS = (
    Format("OBJ", (".obj",), never, f"{_HERE}:read_obj"),
    Format("OFF", (".off",), _may_be_off, f"{_HERE}:read_off_file", is_certain=_is_off),
    Format("PLY", (".ply",), begins(b"ply"), f"{_HERE}:read_ply_file", is_certain=_is_ply),
    Format("STL", (".stl",), lambda path, start: start.startswith(b"solid") and b"facet" in start, f"{_HERE}:read_stl"),
    Format("glTF", (".glb", ".gltf"), begins(b"glTF"), f"{_HERE}:read_gltf"),
    Format(
        *("finite elements", tuple(FINITE_ELEMENTS), lambda path, start: b"<VTKFile" in start[:1024]),
        "topokit.adapters.mesh.formats.finite_elements:read_finite_elements",
        requires=("meshio",),
        is_certain=never,
    ),
    Format("3MF", (".3mf",), begins(ZIP), f"{_HERE}:read_3mf", requires=("lxml", "networkx"), is_certain=_is_3mf),
    Format("DAE", (".dae",), never, f"{_HERE}:read_dae", requires=("collada",)),
    Format(
        *("GIFTI", (".gii",), lambda path, start: b"<GIFTI" in start[:4096], f"{_BRAIN}:read_gifti"),
        requires=("nibabel",),
    ),
    Format(*("FreeSurfer", _FREESURFER, begins(FREESURFER_START), f"{_BRAIN}:read_freesurfer"), requires=("nibabel",)),
)

MESH = Adapter(
    name="mesh",
    description="triangle meshes",
    suffixes=suffixes_of(FORMATS),
    can_open=partial(is_certainly, FORMATS),
    types=(
        *("builtins.tuple", "trimesh.Trimesh", "trimesh.Scene", "meshio.Mesh", "vedo.Mesh", "kaolin.rep.SurfaceMesh"),
        *("pyvista.PolyData", "pyvista.UnstructuredGrid", "pytorch3d.structures.Meshes"),
    ),
    extra="topokit[formats]",
    suffix_requires=requirements_of(FORMATS),
    differentiable=True,
    opener="topokit.adapters.mesh.adapter:from_mesh",
)
