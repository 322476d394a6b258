"""How meshes are recognised, without importing what reads them."""

from __future__ import annotations

import re
from pathlib import Path

from topokit.inputs.files import ZIP, head, ply_kind
from topokit.plugins.adapter import Adapter


class Mesh(Adapter):
    """Triangle meshes; see `topokit.from_mesh`."""

    name = "mesh"
    description = "triangle meshes"
    suffixes = (".obj", ".off", ".ply", ".stl", ".glb", ".gltf", ".3mf")
    types = ("trimesh.Trimesh", "trimesh.Scene")
    extra = "topokit[formats]"
    suffix_requires = ((".3mf", "lxml"), (".3mf", "networkx"))
    differentiable = True
    opener = "topokit.adapters.mesh.adapter:from_mesh"

    def can_open(self, source: Path) -> bool:
        start = head(source)
        if start.startswith(ZIP):
            return b"3D/" in start or b"[Content_Types].xml" in start
        if start.startswith(b"solid"):
            return b"facet" in start
        is_off = re.match(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b", start) is not None
        return is_off or start.startswith(b"glTF") or ply_kind(start) == "mesh"
