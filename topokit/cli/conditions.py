"""Conditions on a row that decide the exit code: `--fail-on unsure`, `--fail-on open,genus>0`."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from topokit.batch.examine import COLUMNS, Row
from topokit.batch.widths import COUNTS, NARROWEST, width_columns


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
        shown = f"{value:.4g}" if isinstance(value, float) else value
        return f"{self.text} ({'unknown' if value is None else shown})"


_WORDS: dict[str, Callable[[Row], bool]] = {
    "certain": lambda row: row["verdict"] == "certain",
    "likely": lambda row: row["verdict"] == "likely",
    "unsure": lambda row: row["verdict"] == "unsure",
    "open": lambda row: row["closed"] is False,
    "non-manifold": lambda row: row["manifold"] is False,
}
_NUMBERS = (
    *("euler", "genus", "components", "pieces", "tunnels", "cavities", "solid_euler", "boundary_loops"),
    *("flipped", "inverted", "self_intersections", *COUNTS, *NARROWEST),
)
_COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
}
EXPECTED = f"{', '.join(_WORDS)}, or a comparison such as genus>0 of {', '.join(_NUMBERS)} by {' '.join(_COMPARISONS)}"


def parse_conditions(texts: Iterable[str], numbers: Sequence[str] = _NUMBERS) -> list[Condition]:
    """The conditions that texts, with commas between several, stand for.

    A number that is unknown meets every comparison: a check must not pass because nothing is known.

    Args:
        texts: as on the command line.
        numbers: names that can be compared; words such as "open" go with those of reports.

    Raises:
        ValueError: if a text is none of those; the message says what was expected.
    """
    return [_parse(part.strip(), numbers) for text in texts for part in text.split(",")]


def _parse(text: str, numbers: Sequence[str]) -> Condition:
    if text in _WORDS and numbers is _NUMBERS:
        return Condition(text, _WORDS[text])
    comparison = rf"({'|'.join(numbers)})\s*({'|'.join(_COMPARISONS)})\s*([-+]?\d+(?:\.\d+)?)"
    found = re.fullmatch(comparison, re.sub(r"(?<=[a-z])-(?=[a-z])", "_", text))
    if found is None or ("." in found[3] and found[1] not in NARROWEST):
        of_pairs = f"a comparison such as {numbers[0]}>0 of {', '.join(numbers)} by {' '.join(_COMPARISONS)}"
        raise ValueError(f"{text!r} is no condition; expected {EXPECTED if numbers is _NUMBERS else of_pairs}.")
    column, compare, number = found[1], _COMPARISONS[found[2]], float(found[3])
    return Condition(text, lambda row: row[column] is None or compare(row[column], number), column)


def needs_places(conditions: Iterable[Condition]) -> bool:
    """Whether a condition is about what is known only where places were looked for."""
    return any(one.column == "self_intersections" for one in conditions)


def require_known(conditions: Iterable[Condition], features: bool | float) -> None:
    """Refuse conditions about widths that are not measured.

    Args:
        conditions: of a command about shapes.
        features: as for `Shape.report`.

    Raises:
        ValueError: if there is one; the message says which option it needs.
    """
    known = (*COLUMNS, *width_columns(features))
    for one in conditions:
        if one.column is not None and one.column not in known:
            needed = "report --above WIDTH" if one.column in COUNTS else "report --features or --above WIDTH"
            raise ValueError(f"{one.text} is about widths, which only topokit {needed} measures.")
