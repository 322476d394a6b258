"""What a glTF file needs that trimesh does not read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from topokit.errors import ReadError
from topokit.inputs.reading import reading, require_bytes

_HEADER = 20  # bytes of a .glb before its JSON
_COMPRESSIONS = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}


def check_compression(path: Path) -> None:
    """Refuse a file whose triangles cannot be read without decompressing them.

    Raises:
        ReadError: if it requires Draco or meshopt, or is damaged.
    """
    description = _description(path)
    required = description.get("extensionsRequired")
    needed = required if isinstance(required, list) else []
    found = [name for name in _COMPRESSIONS if name in needed]
    if found:
        raise ReadError(
            f"{path} is compressed with {_COMPRESSIONS[found[0]]} ({found[0]}), which is not read: export it without "
            "compression (Blender: import it, then export glTF with Compression switched off)."
        )


def _description(path: Path) -> dict[str, Any]:
    """The JSON of a .gltf or .glb."""
    with reading(path, "the glTF reader"), path.open("rb") as file:
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
