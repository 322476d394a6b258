"""How triangle meshes are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import re
from pathlib import Path

from topokit.inputs.files import ZIP, head
from topokit.inputs.ply_header import ply_kind
from topokit.plugins.adapter import Adapter


def is_mesh(source: Path) -> bool:
    """Whether the content is a mesh: 3MF, STL as text, OFF, glTF or a .ply with faces."""
    start = head(source)
    if start.startswith(ZIP):
        return b"3D/" in start or b"[Content_Types].xml" in start
    if start.startswith(b"solid"):
        return b"facet" in start
    is_off = re.match(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b", start) is not None
    return is_off or start.startswith(b"glTF") or ply_kind(start) == "mesh"


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

MESH = Adapter(
    name="mesh",
    description="triangle meshes",
    suffixes=(".obj", ".off", ".ply", ".stl", ".glb", ".gltf", ".3mf", ".dae", *FINITE_ELEMENTS),
    can_open=is_mesh,
    types=(
        *("trimesh.Trimesh", "trimesh.Scene", "meshio.Mesh", "vedo.Mesh", "kaolin.rep.SurfaceMesh"),
        *("pyvista.PolyData", "pyvista.UnstructuredGrid", "pytorch3d.structures.Meshes"),
    ),
    extra="topokit[formats]",
    suffix_requires=(
        *((".3mf", "lxml"), (".3mf", "networkx"), (".dae", "collada")),
        *((suffix, "meshio") for suffix in FINITE_ELEMENTS),
    ),
    differentiable=True,
    opener="topokit.adapters.mesh.adapter:from_mesh",
)
