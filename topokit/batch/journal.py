"""The file of JSON lines of a run that may be stopped and go on: which files are in it, and with what options."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from topokit.batch.names import name_as_data
from topokit.batch.sources import Source
from topokit.errors import InputError
from topokit.inputs.writing import completed_file

Record = dict[str, Any]
Stamp = dict[str, Any]  # what tells a file from others, and from itself after a change
_OPTIONS, _SOURCE = "options", "source"


@dataclass(frozen=True)
class Finished:
    """What a journal knows about the files of a run.

    Attributes:
        records: by the names of the files that are finished.
        n_outdated: how many others are in it, but were changed since, or are there without a stamp.
    """

    records: Mapping[str, list[Record]]
    n_outdated: int


@dataclass(frozen=True)
class Journal:
    """A file of JSON lines, each an object with the key "file", and what the records of this run have in common.

    Attributes:
        path: of the file, which need not exist.
        options: those that change answers, as `plain_options` returns them; each record has them, if there are any.
        columns: the keys that every record has, if they are the same.
        several: whether a file may have several lines, as those of labels.
        retries: whether files that failed count as not examined.
    """

    path: Path
    options: Mapping[str, Any]
    columns: Sequence[str] | None = None
    several: bool = False
    retries: bool = False

    def record(self, values: Mapping[str, Any], stamp: Stamp | None) -> Record:
        """A record with these values, by which its file is known again if there is a stamp."""
        more = ({_OPTIONS: dict(self.options)} if self.options else {}) | ({_SOURCE: stamp} if stamp else {})
        return {**values, **more}

    def finished(self, stamps: Mapping[str, Stamp]) -> Finished:
        """What is known of the files of a run; records that do not count are removed from the file.

        These are those of files that were changed, what was left unfinished at the end, of files with several lines
        all those of the last file, since some of them may be missing, and those that failed, if they are to be tried
        again. Records of files that are not in this run stay.

        Args:
            stamps: of the files of this run, as `stamps_of` returns them.

        Raises:
            InputError: if the file holds something else, or records of a run with other options.
        """
        if not self.path.exists():
            return Finished({}, 0)
        lines = self.path.read_bytes().splitlines(keepends=True)
        if lines and not lines[-1].endswith(b"\n"):
            lines.pop()
        records = [self._checked(number, line) for number, line in enumerate(lines, 1)]
        found = [record.pop(_SOURCE) for record in records]
        current = {stamp["path"]: stamp for stamp in stamps.values()}
        outdated = {stamp["path"] for stamp in found if current.get(stamp["path"], stamp) != stamp}
        left_out = set(outdated)
        if self.retries:
            left_out |= {stamp["path"] for stamp, record in zip(found, records, strict=True) if record.get("error")}
        if self.several and found:
            left_out.add(found[-1]["path"])
        kept = [number for number, stamp in enumerate(found) if stamp["path"] not in left_out]
        self._rewrite(b"".join(lines[number] for number in kept))
        known: dict[str, dict[int | None, Record]] = {}
        for number in kept:  # a file that was given twice has two records: the last one counts
            known.setdefault(found[number]["path"], {})[records[number].get("label")] = records[number]
        by_name = {
            name: list(known[stamp["path"]].values()) for name, stamp in stamps.items() if stamp["path"] in known
        }
        return Finished(by_name, len(outdated))

    def _rewrite(self, content: bytes) -> None:
        if len(content) != self.path.stat().st_size:
            with completed_file(self.path) as unfinished:
                unfinished.write_bytes(content)

    def _checked(self, number: int, line: bytes) -> Record:
        """The record in a line, with a stamp and without options; one without a stamp gets that of no file."""
        where = f"{self.path}, line {number},"
        try:
            record = json.loads(line)
        except ValueError as error:
            raise InputError(f"{where} is not JSON ({error}): it is not the output of such a run.") from error
        if not isinstance(record, dict) or not isinstance(record.get("file"), str):
            raise InputError(f'{where} has no "file": it is not the output of such a run.')
        if (before := record.pop(_OPTIONS, {})) != self.options:
            raise InputError(
                f"{where} was examined with {_described(before)}, and this run has {_described(self.options)}: go on "
                "with the same options, or write to another file."
            )
        stamp = record.setdefault(_SOURCE, {"path": name_as_data(os.path.realpath(record["file"]))})
        if self.columns is not None and record.keys() != {*self.columns, _SOURCE}:
            raise InputError(f"{where} has other columns than a survey; name another file to resume.")
        if not isinstance(stamp, dict) or not isinstance(stamp.get("path"), str):
            raise InputError(f'{where} has another "{_SOURCE}" than such a run writes: it is not the output of one.')
        return record


def stamps_of(sources: Iterable[Source]) -> dict[str, Stamp]:
    """By the name of each source its real path, size in bytes and time of its last change in nanoseconds.

    Of a folder, such as a zarr volume, size and time are those of all files in it, and those of files beside a source
    count, too. An address is known by itself alone.
    """
    return {source.name: _stamp(source) for source in sources}


def _stamp(source: Source) -> Stamp:
    if isinstance(source.path, str):
        return {"path": name_as_data(source.path)}
    places = [place for path in (source.path, *source.beside) for place in _files(path)]
    found = [status for place in places if (status := _status(place)) is not None]
    is_path = source.name == str(source.path) or source.beside
    real = os.path.realpath(source.path) if is_path else source.name
    size, changed = sum(status.st_size for status in found), max((status.st_mtime_ns for status in found), default=None)
    beside = [name_as_data(os.path.realpath(path)) for path in source.beside]
    return {"path": name_as_data(real), "size": size, "changed": changed} | ({"beside": beside} if beside else {})


def _files(path: Path) -> Iterable[str | Path]:
    if not path.is_dir():
        return (path,)
    return (os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names)


def _status(path: str | Path) -> os.stat_result | None:
    try:
        return os.stat(path)
    except OSError:  # it is not there, which its answer says
        return None


def plain_options(adapter: str | None, given: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """The options of a run that change its answers, as JSON has them; None and False are left out.

    Args:
        adapter: name of the adapter, if one is given.
        given: options of the adapter.
        more: other options.
    """
    options = {name: value for name, value in ({"adapter": adapter} | more).items() if value not in (None, False)}
    plain: dict[str, Any] = json.loads(json.dumps({**options, **given}, default=_kind), parse_constant=str)
    return plain


def _kind(value: object) -> str:
    """What stands for a value that JSON lacks, such as a function: the name of its type."""
    return f"{type(value).__module__}.{type(value).__qualname__}"


def _described(options: Any) -> str:
    return f"the options {json.dumps(options, ensure_ascii=False)}" if options else "no options"
