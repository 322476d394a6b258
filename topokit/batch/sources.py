"""Files by path, folder and pattern: what there is to examine."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from topokit.errors import InputError, TopokitError
from topokit.inputs.remote import is_address, matching_addresses
from topokit.plugins.registry import is_known, objection
from topokit.report.wording import plural

if TYPE_CHECKING:
    from topokit.shape import Shape

Named = str | os.PathLike[str]
Paths = Named | Iterable["Named | Shape"]

_SUFFIX, _LETTER = re.compile(r"\.[A-Za-z0-9.]+$"), re.compile("[A-Za-z]")


@dataclass(frozen=True)
class Source:
    """One file or folder to examine, or a shape in memory.

    Attributes:
        path: where it is; a text if that is an address. Of a shape in memory its name.
        name: what to call it in results.
        problem: why there is nothing to examine, or None.
        shape: in memory, or None.
        beside: other files that its answers depend on, such as the truth that it is compared with.
    """

    path: Path | str
    name: str
    problem: str | None = None
    shape: Shape | None = None
    beside: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Sources:
    """What was found: the `sources` in order, and the files in folders that were `passed_over`, of no known format."""

    sources: tuple[Source, ...]
    passed_over: tuple[str, ...]


def find_sources(paths: Paths, adapter: str | None = None) -> Sources:
    """The files that paths, folders and patterns stand for.

    Files and addresses are taken as they are named. Of a folder and the folders in it, those files are taken that an
    adapter knows by content or suffix, sorted by name; what begins with a dot is left out. Patterns are those of
    `glob`: `*`, `?`, `[a-z]`, and `**` for folders at any depth; in addresses only `*` makes one. The suffix at the end
    of a pattern matches capitals and small letters alike. An adapter that runs code takes only files that are named:
    the others have a `problem`.

    Args:
        paths: one or several; a list may hold shapes, too.
        adapter: name of the adapter that will open them; of folders only its files are taken.

    Raises:
        InputError: if one of the paths is something else.
    """
    finder = _Finder(adapter)
    for path in _listed(paths):
        if isinstance(path, Source):
            finder.sources.append(path)
            continue
        if is_address(path):
            finder.add_address(str(path))
            continue
        place = _at_home(os.fspath(path))
        for one in (matches := _expanded(place)):
            finder.add(one, is_named=matches == [Path(place)])
    return Sources(tuple(finder.sources), tuple(finder.passed_over))


class _Finder:
    """Collects the sources of one path after the other."""

    def __init__(self, adapter: str | None) -> None:
        self.adapter = adapter
        self.sources: list[Source] = []
        self.passed_over: list[str] = []

    def add(self, path: Path, is_named: bool) -> None:
        """A file as it is, a folder with all that is in it."""
        if not path.is_dir():
            self.sources.append(Source(path, str(path)) if is_named else self._found(path))
            return
        if is_known(path, self.adapter):
            self.sources.append(self._found(path))
            return
        found, passed_over = len(self.sources), len(self.passed_over)
        self._add_folder(path)
        if len(self.sources) == found:
            n_files = len(self.passed_over) - passed_over
            held = f"of its {plural(n_files, 'file')} none is of a known format" if n_files else "it is empty"
            self._add_problem(path, f"{path} holds nothing that topokit opens: {held}.")

    def add_address(self, address: str) -> None:
        """A file at an address, or those that a pattern stands for; nothing is fetched but their names."""
        try:
            found = matching_addresses(address) if "*" in address else [address]
        except TopokitError as error:
            self.sources.append(Source(address, address, str(error)))
            return
        self.sources += map(self._found, found)

    def _add_folder(self, folder: Path) -> None:
        try:
            names = sorted(os.listdir(folder))
        except OSError as error:
            self._add_problem(folder, f"{folder} could not be listed ({error.strerror}); check its permissions.")
            return
        for path in (folder / name for name in names if not name.startswith(".")):
            if path.is_dir() and not is_known(path, self.adapter):
                if not path.is_symlink():  # which may lead in a circle
                    self._add_folder(path)
            elif path.is_dir() or (path.is_file() and is_known(path, self.adapter)):
                self.sources.append(self._found(path))
            elif path.is_file():
                self.passed_over.append(str(path))

    def _found(self, place: Path | str) -> Source:
        """What was not named as a file by itself."""
        return Source(place, str(place), objection(place, self.adapter))

    def _add_problem(self, path: Path, problem: str) -> None:
        self.sources.append(Source(path, str(path), problem))


def _listed(paths: object) -> list[Named | Source]:
    """What was given, one by one; shapes as sources."""
    given = paths if isinstance(paths, Iterable) and not isinstance(paths, str | os.PathLike) else [paths]
    return [one if isinstance(one, str | os.PathLike) else _in_memory(one) for one in given]


def _in_memory(shape: object) -> Source:
    from topokit.shape import Shape

    if not isinstance(shape, Shape):
        raise InputError(
            f"paths of files, folders and patterns, or shapes, were expected, not {type(shape).__name__}. Make shapes "
            "of objects first: [topokit.load(mesh) for mesh in meshes]."
        )
    return Source(shape.name, shape.name, shape=shape)


def _at_home(path: str) -> str:
    """The path with ~ as the home directory, unless it exists as it is."""
    return path if os.path.lexists(path) else os.path.expanduser(path)


def _expanded(path: str) -> list[Path]:
    """The paths that match a pattern; a path that exists or is no pattern stands for itself."""
    if not glob.has_magic(path) or os.path.lexists(path):
        return [Path(path)]
    pattern = _SUFFIX.sub(lambda suffix: _LETTER.sub(_in_both_cases, suffix[0]), path)
    return [Path(match) for match in sorted(glob.glob(pattern, recursive=True))] or [Path(path)]


def _in_both_cases(letter: re.Match[str]) -> str:
    return f"[{letter[0].lower()}{letter[0].upper()}]"
