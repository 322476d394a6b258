"""One self-contained HTML file of many shapes, written as they come."""

from __future__ import annotations

import base64
import hashlib
import os
import pickle
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import Any

from topokit.errors import InputError
from topokit.inputs.writing import completed_file
from topokit.pages.fragment import PAGES, Fragment
from topokit.report.report import environment, report_styles

_MOST_SCENES = 200_000_000  # bytes of base64 in one page; browsers get slow beyond. Later shapes have a picture only
_IN_MEMORY = 16_000_000  # bytes of entries that wait in memory until the failed ones are written; others wait on disk

SHAPE_COLUMNS = (
    *(("verdict", "verdict"), ("euler", "χ"), ("genus", "genus"), ("components", "components")),
    *(("boundary_loops", "boundary"), ("closed", "closed"), ("pieces", "pieces"), ("tunnels", "tunnels")),
    *(("cavities", "cavities"), ("seconds", "seconds"), ("reason", "reason")),
)
"""Key and heading of the columns of a table of shapes."""


@dataclass(frozen=True)
class Entry:
    """A row of a page.

    Attributes:
        name: what to call it.
        fragment: what there is to show, or None if the file failed.
        error: why it failed, or None.
        seconds: time it took, or None if unknown.
    """

    name: str
    fragment: Fragment | None
    error: str | None = None
    seconds: float | None = None


def write_html(
    entries: Iterable[Entry],
    path: str | os.PathLike[str],
    *,
    title: str | None = None,
    columns: Sequence[tuple[str, str]] = SHAPE_COLUMNS,
) -> None:
    """Write a page with a table of shapes that open in a 3D view; a single shape is shown at once.

    The page needs no other file and no network. Files that failed come first in the table, with their errors. The
    others wait on disk, so memory does not grow with their number. The file appears under its name only when it is
    complete.

    Args:
        entries: one per shape or file, in the order of the table, but for those that failed.
        path: file to write, called .html or .htm.
        title: heading of the page; the file's name by default.
        columns: key among the facts and heading of each column. "verdict", "seconds" and "reason" are known to all.

    Raises:
        InputError: if the file is not called .html or .htm, or its folder does not exist.
    """
    target = Path(path)
    if target.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{target}: a page must be called .html or .htm.")
    if not target.parent.is_dir():
        raise InputError(f"{target}: the folder {target.parent} does not exist.")
    with completed_file(target) as unfinished, unfinished.open("w", encoding="utf-8", newline="\n") as page:
        page.writelines(_page(iter(entries), title or target.stem, columns, str(target.parent)))


def page_text(entry: Entry, title: str | None = None) -> str:
    """The page of a single shape as text."""
    return "".join(_page(iter((entry,)), title or entry.name, SHAPE_COLUMNS))


def _page(
    entries: Iterator[Entry], title: str, columns: Sequence[tuple[str, str]], folder: str | None = None
) -> Iterator[str]:
    """The pieces of a page; entries wait in the folder, or in that of temporary files."""
    script = _static("viewer.min.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    style = report_styles() + _static("page.css")
    rows = _rows(_failed_first(entries, folder))
    template = environment(PAGES).get_template("page.html")
    return template.generate(title=title, style=style, script=script, digest=digest, columns=columns, rows=rows)


def _failed_first(entries: Iterator[Entry], folder: str | None) -> Iterator[tuple[int, Entry]]:
    """Entries by their number, from 1 on: those without a fragment at once, the others after them."""
    with SpooledTemporaryFile(_IN_MEMORY, dir=folder) as waiting:
        n_waiting = 0
        for number, entry in enumerate(entries, start=1):
            if entry.fragment is None:
                yield number, entry
            else:
                pickle.dump((number, entry), waiting)
                n_waiting += 1
        waiting.seek(0)
        for _ in range(n_waiting):
            yield pickle.load(waiting)


def _rows(entries: Iterator[tuple[int, Entry]]) -> Iterator[dict[str, Any]]:
    """What the template needs of each entry."""
    n_bytes = 0
    for number, entry in entries:
        scene, thumbnail = (_base64(getattr(entry.fragment, name, None)) for name in ("scene", "thumbnail"))
        n_bytes += len(scene)
        left_out = scene != "" and n_bytes > _MOST_SCENES
        drawn = {"thumbnail": thumbnail, "scene": "" if left_out else scene, "left_out": left_out}
        yield {"number": number, **vars(entry), **drawn}


def _base64(data: bytes | None) -> str:
    return base64.b64encode(data or b"").decode("ascii")


@cache
def _static(name: str) -> str:
    return files("topokit.pages").joinpath("static", name).read_text(encoding="utf-8")
