"""What a set of shapes is like, and how far two sets are apart: shares, histograms and distances of their topology."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from topokit.errors import InputError

Rows = Sequence[Mapping[str, Any]]

_TOPOLOGY = ("closed", "components", "genus", "cavities")  # what makes two shapes of one kind


@dataclass(frozen=True)
class SurveySummary:
    """What a set of shapes is like. Shares are those of the shapes that could be examined, 0 … 1.

    Attributes:
        n_shapes: shapes that were examined.
        n_errors: files that could not be.
        verdicts: share of each verdict.
        closed: share that is closed.
        manifold: share that is known to be a manifold.
        closed_manifold: share that is both.
        genus: number of shapes of each genus, ascending; None, where it is undefined or unknown, comes last.
        components: number of shapes with each number of components, ascending.
    """

    n_shapes: int
    n_errors: int
    verdicts: Mapping[str, float]
    closed: float
    manifold: float
    closed_manifold: float
    genus: Mapping[int | None, int]
    components: Mapping[int | None, int]


@dataclass(frozen=True)
class TopologyDistance:
    """How far apart the topologies of two sets of shapes are.

    Attributes:
        total_variation: ½ Σ |p − q| over the kinds of topology, which are (closed, components, genus, cavities): 0 if
            all kinds are equally frequent in both sets, 1 if no kind occurs in both.
        genus_wasserstein: 1-Wasserstein distance between the distributions of genus: by how many handles the shapes
            of one set must change on average to become those of the other. None if a set has no shape of known genus.
    """

    total_variation: float
    genus_wasserstein: float | None


def summarize(rows: Rows) -> SurveySummary:
    """The summary of a survey's rows."""
    shapes = [row for row in rows if row["error"] is None]
    verdicts = Counter(row["verdict"] for row in shapes)
    return SurveySummary(
        n_shapes=len(shapes),
        n_errors=len(rows) - len(shapes),
        verdicts={verdict: verdicts[verdict] / len(shapes) for verdict in ("certain", "likely", "unsure") if shapes},
        closed=_share(row["closed"] for row in shapes),
        manifold=_share(row["manifold"] is True for row in shapes),
        closed_manifold=_share(row["closed"] and row["manifold"] is True for row in shapes),
        genus=_histogram(row["genus"] for row in shapes),
        components=_histogram(row["components"] for row in shapes),
    )


def topology_distance(one: Rows, other: Rows) -> TopologyDistance:
    """The distance between two sets of shapes by their rows; files that could not be examined are left out.

    Raises:
        InputError: if a set has no shape.
    """
    first, second = _shapes(one), _shapes(other)
    p, q = _frequencies(first), _frequencies(second)
    return TopologyDistance(
        total_variation=sum(abs(p.get(kind, 0.0) - q.get(kind, 0.0)) for kind in p.keys() | q.keys()) / 2,
        genus_wasserstein=_wasserstein(_known_genera(first), _known_genera(second)),
    )


def _shapes(rows: Rows) -> Rows:
    shapes = [row for row in rows if row["error"] is None]
    if not shapes:
        raise InputError(f"a set of {len(rows)} files has no shape that could be examined, so it has no distance.")
    return shapes


def _frequencies(shapes: Rows) -> dict[Hashable, float]:
    counts = Counter(tuple(row[name] for name in _TOPOLOGY) for row in shapes)
    return {kind: count / len(shapes) for kind, count in counts.items()}


def _known_genera(shapes: Rows) -> list[int]:
    return [row["genus"] for row in shapes if row["genus"] is not None]


def _wasserstein(one: list[int], other: list[int]) -> float | None:
    if not one or not other:
        return None
    from scipy.stats import wasserstein_distance

    return float(wasserstein_distance(one, other))


def _share(are: Iterable[bool]) -> float:
    values = list(are)
    return sum(values) / len(values) if values else 0.0


def _histogram(values: Iterable[int | None]) -> dict[int | None, int]:
    counts = Counter(values)
    return {value: counts[value] for value in sorted(counts, key=lambda value: (value is None, value))}
