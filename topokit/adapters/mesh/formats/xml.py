"""XML that is dangerous to read."""

from __future__ import annotations

from pathlib import Path

from topokit.errors import ReadError
from topokit.inputs.files import head


def refuse_entities(path: Path) -> None:
    """Refuse XML that defines entities, with which a small file grows without bound.

    Raises:
        ReadError: if it does.
    """
    beginning = head(path)
    is_xml = beginning.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")
    if is_xml and (b"<!DOCTYPE" in beginning or b"<!ENTITY" in beginning):
        raise ReadError(f"{path} defines XML entities (DOCTYPE), which such files do not need: it is not read.")
