"""Names of files: short ones that still tell them apart, and those that files of data can hold."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import quote

from topokit.batch.sources import Source
from topokit.inputs.remote import is_address
from topokit.text import is_unicode

_ASCII = "".join(map(chr, range(0x21, 0x7F)))


def distinguishing_names(sources: Sequence[Source]) -> dict[str, str]:
    """By the name of each source as few of the last parts of its path as no other source ends with."""
    parts = {source.name: Path(source.name).parts for source in sources}
    endings = Counter(path[start:] for path in parts.values() for start in range(len(path)))
    return {name: _shortest(path, endings) or name for name, path in parts.items()}


def _shortest(path: tuple[str, ...], endings: Counter[tuple[str, ...]]) -> str:
    starts = reversed(range(len(path)))
    return str(Path(*next((path[start:] for start in starts if endings[path[start:]] == 1), path)))


def names_in_common_folder(sources: Sequence[Source]) -> dict[str, str]:
    """By the name of each source its path below the folder that all of them have in common, with / between folders.

    Such names say nothing about the machine. Standard input and addresses keep their own; where there is no such
    folder, as on two drives, they are those of `distinguishing_names`.
    """
    places = {
        source.name: Path(os.path.abspath(source.path))
        for source in sources
        if isinstance(source.path, Path) and source.name == str(source.path)
    }
    try:
        folder = os.path.commonpath([place.parent for place in places.values()]) if places else ""
    except ValueError:
        return distinguishing_names(sources)
    names = {source.name: source.name for source in sources}
    return names | {name: place.relative_to(folder).as_posix() for name, place in places.items()}


def name_as_data(name: str, is_fit: Callable[[str], bool] = is_unicode) -> str:
    """The name of a file as JSON, CSV and Parquet hold it: as it is, or as a file: address with %XX for bytes.

    Args:
        name: of a source.
        is_fit: whether the format can hold a name; by default every one that is UTF-8.

    Reference:
        RFC 8089 (file: addresses).
    """
    if is_fit(name):
        return name
    return quote(os.fsencode(name), safe=_ASCII) if is_address(name) else Path(name).absolute().as_uri()
