"""What a glTF file needs that trimesh does not read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from topokit.errors import ReadError
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_bytes, require_expansion

_HEADER = 20  # bytes of a .glb before its JSON
_COMPONENT_BYTES = {"5120": 1, "5121": 1, "5122": 2, "5123": 2, "5125": 4, "5126": 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_COMPRESSIONS = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}


def check_gltf(path: Path) -> None:
    """Refuse a file whose triangles cannot be read, or that announces more than it holds.

    Raises:
        ReadError: if it requires Draco or meshopt, is too short, has no tree of nodes, or is damaged.
    """
    description = _description(path)
    _check_chunks(path)
    _check_compression(path, description)
    _check_sizes(path, description)


def _check_chunks(path: Path) -> None:
    """Refuse a .glb whose chunks are longer than the file."""
    size, at = path.stat().st_size, 12
    with path.open("rb") as file:
        is_binary = file.read(4) == b"glTF"
        while is_binary and at + 8 <= size:
            file.seek(at)
            length = int.from_bytes(file.read(4), "little")
            require_bytes(path, f"a chunk at byte {at}", length, size - at - 8)
            at += 8 + length


def _check_compression(path: Path, description: dict[str, Any]) -> None:
    required = description.get("extensionsRequired")
    needed = required if isinstance(required, list) else []
    found = [name for name in _COMPRESSIONS if name in needed]
    if found:
        raise ReadError(
            f"{path} is compressed with {_COMPRESSIONS[found[0]]} ({found[0]}), which is not read: export it without "
            "compression (Blender: import it, then export glTF with Compression switched off)."
        )


def _check_sizes(path: Path, description: dict[str, Any]) -> None:
    """Refuse numbers that no buffer holds, and nodes that are no tree, as which a short list makes a huge scene."""
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


def _description(path: Path) -> dict[str, Any]:
    """The JSON of a .gltf or .glb."""
    with reading(path, "the glTF reader", RecursionError), path.open("rb") as file:
        start = file.read(_HEADER)
        if start.startswith(b"glTF") and len(start) < _HEADER:
            raise ValueError("the header is cut off")
        if start.startswith(b"glTF"):
            length = int.from_bytes(start[12:16], "little")
            require_bytes(path, "its description", length, path.stat().st_size - _HEADER)
            content = file.read(length)
        else:
            content = start + file.read()
        found = json.loads(content.decode("utf-8", "replace").rstrip("\0 "))
    if not isinstance(found, dict):
        raise ReadError(f"{path} is no glTF: its JSON is no object.")
    return found
