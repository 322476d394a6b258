"""Scenes through trimesh, bounded: no other file is opened but buffers of a .gltf, and nothing grows without limit."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from topokit.errors import ReadError
from topokit.inputs.files import file_beside
from topokit.inputs.size_limits import require_expansion

_FACE_BYTES = 60  # of a triangle in memory, with its share of vertices


def load_flattened(content: Any, kind: str, path: Path) -> Any:
    """All triangles of a file as one `trimesh.Trimesh`, with the transformations of its scene.

    Args:
        content: the path, or a stream with what trimesh is to read instead.
        kind: the format, as the suffix without its dot.
        path: the file, for errors and for buffers beside it.

    Raises:
        ReadError: if the file announces or refers to more than it holds, or refers to other files than buffers of a
            .gltf in its own folder.
    """
    import trimesh

    resolver = _Buffers(path) if kind == "gltf" else _NoOtherFile(path)
    more = _without_textures(kind)
    with content.open("rb") if isinstance(content, Path) else content as stream:  # trimesh needs names in UTF-8
        scene = trimesh.load_scene(stream, file_type=kind, resolver=resolver, process=False, **more)
        return _flattened(scene, path)


class _NoOtherFile:
    """What trimesh asks for other files: there are none. Textures and materials do not matter here."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def get(self, name: str) -> bytes:
        """Nothing.

        Raises:
            ReadError: always.
        """
        raise ReadError(f"{self.path} refers to {name!r}; other files than the given one are not opened.")

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def __contains__(self, name: object) -> bool:
        return False

    def keys(self) -> list[str]:
        """No names."""
        return []

    def namespaced(self, namespace: str) -> _NoOtherFile:
        """The same for a folder."""
        return self


class _Buffers(_NoOtherFile):
    """The buffers of a .gltf: files in its folder, or in folders there, that are no links to elsewhere."""

    def get(self, name: str) -> bytes:
        """The bytes of a buffer.

        Raises:
            ReadError: if it is missing, or elsewhere.
        """
        return file_beside(self.path, unquote(name)).read_bytes()


def _without_textures(kind: str) -> dict[str, Any]:
    return {"skip_materials": True} if kind in ("glb", "gltf", "obj", "ply") else {}


def _flattened(scene: Any, path: Path) -> Any:
    """All of a scene as one `trimesh.Trimesh`; a single mesh that stays in place is not copied."""
    nodes = scene.graph.nodes_geometry
    if len(nodes) == 1:
        transformation, name = scene.graph[nodes[0]]
        only = scene.geometry[name]
        if hasattr(only, "faces") and np.array_equal(transformation, np.eye(4)):
            return only
    parts = (scene.geometry[scene.graph[node][1]] for node in nodes)
    n_faces = sum(len(part.faces) for part in parts if hasattr(part, "faces"))
    require_expansion(path, _FACE_BYTES * n_faces, path.stat().st_size)
    return scene.to_mesh()
