"""Binary STL files whose count of triangles is not that of their triangles."""

from __future__ import annotations

import io
from pathlib import Path

from topokit.errors import ReadError
from topokit.inputs.files import head

_HEADER, _TRIANGLE = 84, 50  # bytes
_UNKNOWN = (0, 0xFFFFFFFF)  # counts of programs that write triangles as they come, and never go back


def is_binary_stl(path: Path) -> bool:
    """Whether this is no STL as text, which begins with "solid" as some binary ones do."""
    beginning = head(path, 1024)
    return beginning.lstrip()[:5].lower() != b"solid" or b"\0" in beginning


def counted_stl(path: Path) -> Path | io.BytesIO:
    """The file, or its bytes with the right count: where the header leaves it open, or bytes follow the triangles.

    Raises:
        ReadError: if the file holds fewer triangles than it announces, or more.
    """
    size = path.stat().st_size
    announced = int.from_bytes(head(path, _HEADER)[-4:], "little")
    held, rest = divmod(size - _HEADER, _TRIANGLE)
    if size < _HEADER + _TRIANGLE or (announced == held and not rest):
        return path  # of a file that is too short trimesh says so
    if announced in _UNKNOWN and not rest:
        announced = held
    if announced != held:
        raise ReadError(
            f"{path} announces {announced} triangles and has bytes for {held}: it is truncated or its header is wrong. "
            "Export it again."
        )
    content = path.read_bytes()[: _HEADER + held * _TRIANGLE]
    return io.BytesIO(content[: _HEADER - 4] + held.to_bytes(4, "little") + content[_HEADER:])
