"""OBJ files without what topology does not need."""

from __future__ import annotations

import io
import re
from pathlib import Path

from topokit.errors import ReadError


def bare_obj(path: Path) -> io.BytesIO:
    """The `v` and `f` lines alone, faces without texture and normal indices, indices counted from the beginning.

    Faces name vertices, normals, textures and materials apart and topology goes by the vertex alone; trimesh would
    split vertices wherever any of them differs.

    Raises:
        ReadError: if a face names vertex 0, or one that is not there.
    """
    content = path.read_bytes().replace(b"\t", b" ")
    if b"\\" in content:
        content = re.sub(rb"\\\r?\n", b" ", content)  # continued lines
    lines = [line for line in map(bytes.strip, content.split(b"\n")) if line[:2] in (b"v ", b"f ")]
    bare = b"\n".join(lines)
    bare = re.sub(rb"/\S*|#.*", b"", bare) if b"/" in bare or b"#" in bare else bare
    if re.search(rb"^f .*-", bare, re.MULTILINE):
        bare = _counted_from_the_beginning(path, bare.split(b"\n"))
    if re.search(rb"^f (.* )?0+( |$)", bare, re.MULTILINE):
        raise ReadError(f"{path} has a face with vertex 0; OBJ files count vertices from 1. Export it again.")
    return io.BytesIO(bare)


def _counted_from_the_beginning(path: Path, lines: list[bytes]) -> bytes:
    """Lines whose faces name no vertex by a negative number: −1 is the last vertex before the face."""
    n_vertices = 0
    for number, line in enumerate(lines):
        if line.startswith(b"v "):
            n_vertices += 1
        elif b"-" in line:
            words = [int(word) for word in line.split()[1:]]
            corners = [word + n_vertices + 1 if word < 0 else word for word in words]
            if min(corners) < 1:
                raise ReadError(f"{path} has a face with vertex {min(words)}, and {n_vertices} vertices before it.")
            lines[number] = b"f " + b" ".join(b"%d" % corner for corner in corners)
    return b"\n".join(lines)
