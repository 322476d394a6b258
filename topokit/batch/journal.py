"""The file of JSON lines of a run that may be stopped and go on: which files are in it, and where the next one goes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from topokit.errors import InputError

Record = dict[str, Any]


def finished_records(path: Path, *, several: bool) -> list[Record]:
    """The records of all files that a run has finished; what it left unfinished at the end is cut off.

    Args:
        path: of JSON lines, each an object with the key "file"; it need not exist.
        several: whether a file may have several lines. The last file's are then cut off: some of them may be missing.

    Raises:
        InputError: if it holds something else.
    """
    if not path.exists():
        return []
    lines = path.read_bytes().splitlines(keepends=True)
    if lines and not lines[-1].endswith(b"\n"):
        lines.pop()
    records = [_record(path, number, line) for number, line in enumerate(lines, 1)]
    if several and records:
        last = records[-1]["file"]
        while records and records[-1]["file"] == last:
            records.pop()
    with path.open("r+b") as file:
        file.truncate(sum(map(len, lines[: len(records)])))
    return records


def _record(path: Path, number: int, line: bytes) -> Record:
    try:
        record = json.loads(line)
    except ValueError as error:
        raise InputError(
            f"{path}, line {number}, is not JSON ({error}): it is not the output of such a run."
        ) from error
    if not isinstance(record, dict) or not isinstance(record.get("file"), str):
        raise InputError(f'{path}, line {number}, has no "file": it is not the output of such a run.')
    return record
