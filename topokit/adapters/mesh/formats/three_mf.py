"""3MF files: what their archive and their components may grow to."""

from __future__ import annotations

import io
import zipfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from topokit.errors import ReadError
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_members

_FREE_XML = 1 << 26  # bytes of XML that any archive may hold: its tree takes up to twenty times as much
_MOST_INSTANCES = 1 << 16  # of objects in a 3MF file, each of which has a matrix and a name


def check_3mf(path: Path) -> None:
    """Refuse an archive that expands absurdly, and components within components that multiply without bound."""
    with reading(path, "zipfile", NotImplementedError, RuntimeError), zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        require_members(path, entries, _FREE_XML)
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
