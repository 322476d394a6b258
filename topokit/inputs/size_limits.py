"""How much a file may announce, and a compressed one expand to: no header is trusted with memory."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path

from topokit.errors import ReadError

_FREE = 1 << 28  # bytes that any compressed file may expand to
FREE_OF_MASKS = 1 << 30
"""Bytes that a compressed volume may expand to: masks of one organ in a whole body do so by a factor of 1000."""

_MOST_EXPANSION = 200  # real splat scenes and arrays expand 2 to 20 times


def require_bytes(path: Path | str, what: str, needed: int, available: int) -> None:
    """Refuse a header that announces more than the file holds, before memory is allocated for it.

    Raises:
        ReadError: if `needed` exceeds `available`.
    """
    if needed > available:
        raise ReadError(
            f"{path} announces {what}, which takes at least {needed} bytes, but has {available} bytes for it: "
            "it is truncated or its header is wrong. Export or download it again."
        )


def most_expanded(packed: int, free: int = _FREE) -> int:
    """The bytes to which so many packed bytes may expand."""
    return max(free, _MOST_EXPANSION * packed)


def require_expansion(path: Path | str, needed: int, file_size: int, free: int = _FREE) -> None:
    """Refuse a small compressed file that expands to an absurd amount of memory.

    Raises:
        ReadError: if `needed` bytes are more than `free` (256 MiB) and more than 200 times the file's size.
    """
    if needed > most_expanded(file_size, free):
        raise ReadError(
            f"{path} has {file_size} bytes and announces content of {needed} bytes, more than {_MOST_EXPANSION} times "
            "its size: its header is wrong or it is a decompression bomb. Export or download it again."
        )


def require_members(path: Path, members: Iterable[zipfile.ZipInfo], free: int = _FREE) -> None:
    """Refuse members of a zip archive that claim more packed bytes than it has: they are allocated before any is read.

    Raises:
        ReadError: if they do, or expand to more than `free` bytes (256 MiB) and 200 times the archive's size.
    """
    found, size = list(members), path.stat().st_size
    packed = sum(member.compress_size for member in found)
    require_bytes(path, f"{len(found)} members of {packed} packed bytes", packed, size)
    require_expansion(path, sum(member.file_size for member in found), size, free)
