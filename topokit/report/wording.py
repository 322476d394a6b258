"""Wording shared by the sentences of reports."""

from __future__ import annotations


def plural(count: int, one: str, many: str | None = None) -> str:
    """The count with its noun: "1 vertex", "2 vertices"."""
    return f"{count} {one if count == 1 else many or one + 's'}"
