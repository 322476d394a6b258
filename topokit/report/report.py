"""What topokit answers: a report with its evidence, a verdict that never claims what it does not know, and reasons."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from topokit.core.components import SurfaceComponent
from topokit.errors import GenusError
from topokit.report.verdict import Verdict


@dataclass(frozen=True)
class Evidence:
    """One way in which the Euler characteristic was found.

    Attributes:
        name: what was computed.
        value: the raw value.
        integer: the integer it stands for, or None.
        seconds: time it took.
    """

    name: str
    value: float
    integer: int | None
    seconds: float


@dataclass(frozen=True)
class CountedAnswer:
    """A combinatorial answer that an adapter brings along.

    Attributes:
        evidence: where it comes from.
        components: the surface's connected components.
        closed: whether the surface is a closed manifold.
        boundary_loops: closed boundary curves in all, or None if they were not counted.
        verdict: what the answer may be called.
        reasons: plain sentences.
        resolution: size of the smallest feature that the evidence can see, in units of length; None if it is exact.
        further: other witnesses that were heard.
    """

    evidence: Evidence
    components: Sequence[SurfaceComponent]
    closed: bool
    boundary_loops: int | None
    verdict: Verdict
    reasons: tuple[str, ...]
    resolution: float | None = None
    further: tuple[Evidence, ...] = ()


@dataclass(frozen=True)
class TopologyReport:
    """The topology of a surface, and how far it may be believed.

    Attributes:
        name: what was examined.
        euler: Euler characteristic χ of the surface, summed over components: the best integer there is, whatever the
            verdict. None only if there is nothing to go by.
        genus: handles summed over components, or None where that has no meaning or is not known.
        components: connected components of the surface (a hollow ball has two).
        cavities: components that bound a hole inside a solid, or None if that is not known.
        betti: (b0, b1, b2) = (c, 2g, c) of a closed surface, else None.
        boundary_loops: closed boundary curves, or None if they were not counted.
        closed: whether the surface is (or, for samples, looks) closed.
        verdict: "certain" is proven by combinatorics; "likely" means that independent witnesses agree; "unsure" means
            that they do not, that there is only one, or that the surface is open.
        reasons: plain sentences with their numbers.
        evidence: every witness that was heard.
        estimate: the raw Gauss–Bonnet estimate χ⁽⁰⁾, or None if the samples are too few.
        refined: the self-optimised χ⁽ᴷ⁾, or None if it was not computed.
        resolution: size of the smallest feature that the evidence can see, in units of length; None if it is exact.
        per_component: what is known about each component, largest area first.
    """

    name: str
    euler: int | None
    genus: int | None
    components: int
    cavities: int | None
    betti: tuple[int, int, int] | None
    boundary_loops: int | None
    closed: bool
    verdict: Verdict
    reasons: tuple[str, ...]
    evidence: tuple[Evidence, ...]
    estimate: float | None
    refined: float | None
    resolution: float | None
    per_component: Sequence[SurfaceComponent]

    def to_dict(self) -> dict[str, Any]:
        """Plain dicts, lists, numbers and strings, ready for JSON. NaN never occurs."""
        result: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        for key in ("evidence", "per_component"):
            result[key] = [{f.name: getattr(one, f.name) for f in fields(one)} for one in result[key]]
        return result

    def to_json(self, indent: int | None = None) -> str:
        """The report as JSON text; tuples become lists."""
        return json.dumps(self.to_dict(), indent=indent, ensure_ascii=False, allow_nan=False)

    def __str__(self) -> str:
        answer = "unknown" if self.euler is None else str(self.euler)
        head = f"{self.name}: Euler characteristic {answer} ({self.verdict})"
        if self.genus is not None:
            head += f", genus {self.genus}"
        head += f", {self.components} component{'s' if self.components != 1 else ''}"
        head += ", closed" if self.closed else ", not closed"
        return "\n".join([head, *(f"  - {reason}" for reason in self.reasons)])


def known_genus(report: TopologyReport) -> int:
    """The report's genus.

    Raises:
        GenusError: if it has none; the message holds the report's reasons.
    """
    if report.genus is None:
        why = " ".join(report.reasons) or "Nothing is known about it."
        raise GenusError(f"{report.name} has no genus that topokit can vouch for. {why}")
    return report.genus


def betti_numbers(components: Sequence[SurfaceComponent], closed: bool) -> tuple[int, int, int] | None:
    """(c, 2g, c) of a closed orientable surface, else None."""
    handles = sum_genus(components)
    return (len(components), 2 * handles, len(components)) if closed and handles is not None else None


def sum_genus(components: Sequence[SurfaceComponent]) -> int | None:
    """Genus summed over components, None if any is unknown."""
    genera = [component.genus for component in components if component.genus is not None]
    return sum(genera) if len(genera) == len(components) else None


def count_cavities(components: Sequence[SurfaceComponent]) -> int | None:
    """Components at odd nesting depth, None if any depth is unknown."""
    depths = [component.depth for component in components if component.depth is not None]
    return sum(depth % 2 for depth in depths) if len(depths) == len(components) else None
