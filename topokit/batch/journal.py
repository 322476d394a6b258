"""The file of JSON lines of a run that may be stopped and go on: which files are in it, and with what options."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from topokit.errors import InputError
from topokit.inputs.writing import completed_file

Record = dict[str, Any]
_OPTIONS = "options"


@dataclass(frozen=True)
class Journal:
    """A file of JSON lines, each an object with the key "file", and what the records of this run have in common.

    Attributes:
        path: of the file, which need not exist.
        options: those that change answers, as `plain_options` returns them; each record has them, if there are any.
        several: whether a file may have several lines, as those of labels.
        retries: whether files that failed count as not examined.
    """

    path: Path
    options: Mapping[str, Any]
    several: bool = False
    retries: bool = False

    def record(self, values: Mapping[str, Any]) -> Record:
        """A record with these values."""
        return {**values, _OPTIONS: dict(self.options)} if self.options else dict(values)

    def finished(self) -> list[Record]:
        """The records of all files that are finished, without their options; others are removed from the file.

        Others are what was left unfinished at the end, of files with several lines all those of the last file, since
        some of them may be missing, and those that failed, if they are to be tried again.

        Raises:
            InputError: if the file holds something else, or records of a run with other options.
        """
        if not self.path.exists():
            return []
        lines = self.path.read_bytes().splitlines(keepends=True)
        if lines and not lines[-1].endswith(b"\n"):
            lines.pop()
        records = [self._checked(number, line) for number, line in enumerate(lines, 1)]
        left_out = {record["file"] for record in records if self.retries and record.get("error")}
        if self.several and records:
            left_out.add(records[-1]["file"])
        kept = [number for number, record in enumerate(records) if record["file"] not in left_out]
        content = b"".join(lines[number] for number in kept)
        if len(content) != self.path.stat().st_size:
            with completed_file(self.path) as unfinished:
                unfinished.write_bytes(content)
        return [records[number] for number in kept]

    def _checked(self, number: int, line: bytes) -> Record:
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
        return record


def plain_options(adapter: str | None, given: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """The options of a run that change its answers, as JSON has them; None and False are left out.

    Args:
        adapter: name of the adapter, if one is given.
        given: options of the adapter.
        more: other options.
    """
    options = {name: value for name, value in ({"adapter": adapter} | more).items() if value not in (None, False)}
    plain: dict[str, Any] = json.loads(json.dumps({**options, **given}, default=_kind))
    return plain


def _kind(value: object) -> str:
    """What stands for a value that JSON lacks, such as a function: the name of its type."""
    return f"{type(value).__module__}.{type(value).__qualname__}"


def _described(options: Any) -> str:
    return f"the options {json.dumps(options, ensure_ascii=False)}" if options else "no options"
