"""Binary STL files whose count of triangles is not that of their triangles."""

from __future__ import annotations

import io
import re
from pathlib import Path

from topokit.errors import ReadError
from topokit.inputs.files import head

_HEADER, _TRIANGLE = 84, 50  # bytes
_CONTROLS = re.compile(rb"[\0-\x08\x0e-\x1f\x7f]")  # letters that text does not have
_LAST_LINE = 4096  # bytes in which it begins
_UNKNOWN = (0, 0xFFFFFFFF)  # counts of programs that write triangles as they come, and never go back


def _is_binary(path: Path) -> bool:
    """Whether this is no STL as text, which begins with "solid" as some binary ones do."""
    beginning = head(path, 1024)
    return beginning.lstrip()[:5].lower() != b"solid" or b"\0" in beginning


def _require_end(path: Path) -> None:
    """Refuse STL as text without its last line, of which trimesh reads nothing."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LAST_LINE))
        if b"endsolid" in file.read().lower():
            return
    n_facets = path.read_bytes().lower().count(b"endfacet")
    raise ReadError(
        f"{path} does not end with 'endsolid', after {n_facets} triangles: it is truncated. Export it again."
    )


def counted_stl(path: Path) -> Path | io.BytesIO:
    """The file, or its bytes with the right count: where the header leaves it open, or bytes follow the triangles.

    STL as text has no count, but a last line.

    Raises:
        ReadError: if the file is truncated or not STL, or holds fewer triangles than it announces, or more.
    """
    if not _is_binary(path):
        _require_end(path)
        return path
    size, start = path.stat().st_size, head(path, _HEADER)
    if start.isascii() and not _CONTROLS.search(start):
        raise ReadError(
            f"{path} is text, and STL as text begins with 'solid': it is something else under that name, or its first "
            "line is missing."
        )
    if size < _HEADER:
        raise ReadError(
            f"{path} has {size} bytes, and the header of a binary .stl file has {_HEADER}: it is truncated."
        )
    announced = int.from_bytes(start[-4:], "little")
    held, rest = divmod(size - _HEADER, _TRIANGLE)
    if announced == held and not rest:
        return path
    if announced in _UNKNOWN and not rest:
        announced = held
    if announced != held:
        raise ReadError(
            f"{path} announces {announced} triangles and has bytes for {held}: it is truncated or its header is wrong. "
            "Export it again."
        )
    content = path.read_bytes()[: _HEADER + held * _TRIANGLE]
    return io.BytesIO(content[: _HEADER - 4] + held.to_bytes(4, "little") + content[_HEADER:])
