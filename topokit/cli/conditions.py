"""Conditions on a row that decide the exit code: `--fail-on unsure`, `--fail-on open,genus>0`."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from topokit.batch.examine import Row


@dataclass(frozen=True)
class Condition:
    """What a row may meet.

    Attributes:
        text: as it is written on the command line.
        meets: whether a row does.
        column: the number that it is about, if it is about one.
    """

    text: str
    meets: Callable[[Row], bool]
    column: str | None = None

    def found(self, row: Row) -> str:
        """The condition with the number of a row: "genus>0 (6)"."""
        if self.column is None:
            return self.text
        value = row[self.column]
        return f"{self.text} ({'unknown' if value is None else value})"


_WORDS: dict[str, Callable[[Row], bool]] = {
    "certain": lambda row: row["verdict"] == "certain",
    "likely": lambda row: row["verdict"] == "likely",
    "unsure": lambda row: row["verdict"] == "unsure",
    "open": lambda row: row["closed"] is False,
    "non-manifold": lambda row: row["manifold"] is False,
}
_NUMBERS = ("euler", "genus", "components", "pieces", "tunnels", "cavities", "solid_euler", "boundary_loops")
_COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
}
_COMPARISON = re.compile(rf"({'|'.join(_NUMBERS)})\s*({'|'.join(_COMPARISONS)})\s*([-+]?\d+)")

EXPECTED = f"{', '.join(_WORDS)}, or a comparison such as genus>0 of {', '.join(_NUMBERS)} by {' '.join(_COMPARISONS)}"


def parse_conditions(texts: Iterable[str]) -> list[Condition]:
    """The conditions that texts, with commas between several, stand for.

    A number that is unknown meets every comparison: a check must not pass because nothing is known.

    Raises:
        ValueError: if a text is none of those; the message says what was expected.
    """
    return [_parse(part.strip()) for text in texts for part in text.split(",")]


def _parse(text: str) -> Condition:
    if text in _WORDS:
        return Condition(text, _WORDS[text])
    found = _COMPARISON.fullmatch(text.replace("-loops", "_loops").replace("solid-", "solid_"))
    if found is None:
        raise ValueError(f"{text!r} is no condition; expected {EXPECTED}.")
    column, compare, number = found[1], _COMPARISONS[found[2]], int(found[3])
    return Condition(text, lambda row: row[column] is None or compare(row[column], number), column)
