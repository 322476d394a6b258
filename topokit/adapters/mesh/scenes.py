"""Scenes through trimesh, bounded: no other file is opened but buffers of a .gltf, and nothing grows without limit."""

from __future__ import annotations

import io
import json
import zipfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from topokit.errors import ReadError
from topokit.inputs.beside import file_beside
from topokit.inputs.ply import check_header
from topokit.inputs.reading import reading, require_bytes, require_expansion

_GLB_HEADER = 20  # bytes before the JSON
_COMPONENT_BYTES = {"5120": 1, "5121": 1, "5122": 2, "5123": 2, "5125": 4, "5126": 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_FACE_BYTES = 60  # of a triangle in memory, with its share of vertices
_FREE_XML = 1 << 26  # bytes of XML that any archive may hold: its tree takes up to twenty times as much
_MOST_INSTANCES = 1 << 16  # of objects in a 3MF file, each of which has a matrix and a name


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

    if kind in ("glb", "gltf"):
        _check_gltf(path)
    if kind == "3mf":
        _check_3mf(path)
    if kind == "ply":
        check_header(path)
    resolver = _Buffers(path) if kind == "gltf" else _NoOtherFile(path)
    scene = trimesh.load_scene(content, file_type=kind, resolver=resolver, process=False, **_without_textures(kind))
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


def gltf_description(path: Path) -> dict[str, Any]:
    """The JSON of a .gltf or .glb.

    Raises:
        ReadError: if it is damaged.
    """
    with reading(path, "the glTF reader", RecursionError), path.open("rb") as file:
        start = file.read(_GLB_HEADER)
        if start.startswith(b"glTF"):
            length = int.from_bytes(start[12:16], "little")
            require_bytes(path, "its description", length, path.stat().st_size - _GLB_HEADER)
            content = file.read(length)
        else:
            content = start + file.read()
        found = json.loads(content.decode("utf-8", "replace").rstrip("\0 "))
    if not isinstance(found, dict):
        raise ReadError(f"{path} is no glTF: its JSON is no object.")
    return found


def _check_gltf(path: Path) -> None:
    """Refuse numbers that no buffer holds, and nodes that are no tree, as which a short list makes a huge scene."""
    description = gltf_description(path)
    needed = sum(map(_accessor_bytes, _entries(description, "accessors")))
    require_expansion(path, needed, path.stat().st_size + _buffer_bytes(path, description))
    children = [repr(child) for node in _entries(description, "nodes") for child in _list(node, "children")]
    roots = {repr(root) for scene in _entries(description, "scenes") for root in _list(scene, "nodes")}
    if len({*children}) < len(children) or roots.intersection(children):
        raise ReadError(f"{path}: a node of its scene has two parents, which glTF does not allow. Export it again.")


def _accessor_bytes(accessor: dict[str, Any]) -> int:
    count = accessor.get("count")
    n_bytes = _COMPONENT_BYTES.get(str(accessor.get("componentType")), 8)
    n_bytes *= _COMPONENTS.get(str(accessor.get("type")), 1)
    return count * n_bytes if isinstance(count, int) else 0


def _buffer_bytes(path: Path, description: dict[str, Any]) -> int:
    """Bytes of the buffers of a .gltf that are files beside it."""
    names = [buffer.get("uri") for buffer in _entries(description, "buffers")]
    beside = [path.parent / unquote(name) for name in names if isinstance(name, str) and not name.startswith("data:")]
    return sum(place.stat().st_size for place in beside if place.is_file())


def _list(table: dict[str, Any], key: str) -> list[Any]:
    found = table.get(key)
    return found if isinstance(found, list) else []


def _entries(description: dict[str, Any], key: str) -> list[dict[str, Any]]:
    """The dictionaries in a list of the description."""
    return [one for one in _list(description, key) if isinstance(one, dict)]


def _check_3mf(path: Path) -> None:
    """Refuse an archive that expands absurdly, and components within components that multiply without bound."""
    with reading(path, "zipfile", NotImplementedError, RuntimeError), zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        require_expansion(path, sum(entry.file_size for entry in entries), path.stat().st_size, _FREE_XML)
        models = [entry for entry in entries if "3d/3dmodel.model" in entry.filename.lower()]
        if not models:
            raise ReadError(f"{path} holds no 3D/3dmodel.model; it is not a 3MF file or it is damaged.")
        content = archive.read(models[0])
    if b"component" in content:
        _check_components(path, content)


def _check_components(path: Path, content: bytes) -> None:
    from lxml import etree

    graph: dict[str, list[str]] = {}
    items: list[str] = []
    tags = ("{*}object", "{*}item")
    with reading(path, "lxml", etree.LxmlError, AssertionError):
        for _, element in etree.iterparse(io.BytesIO(content), tag=tags, events=("end",), resolve_entities=False):
            if element.tag.endswith("item"):
                items.append(element.get("objectid", ""))
            else:
                inner = [component.get("objectid", "") for component in element.iter("{*}component")]
                graph.setdefault(element.get("id", ""), []).extend(inner)
            element.clear()
    if _count_paths(items, graph) > _MOST_INSTANCES:
        raise ReadError(f"{path}: its components hold each other more than {_MOST_INSTANCES} times; it is not read.")


def _count_paths(roots: Iterable[str], graph: dict[str, list[str]]) -> int:
    """Paths from the roots along the graph; as many as are too many where it has a circle."""
    level, total = dict(Counter(roots)), 0
    for _ in range(len(graph) + 2):
        total += sum(level.values())
        below: dict[str, int] = {}
        for name, count in level.items():
            for inner in graph.get(name, ()):
                below[inner] = below.get(inner, 0) + count
        level = below
        if not level or total > _MOST_INSTANCES:
            return total
    return _MOST_INSTANCES + 1
