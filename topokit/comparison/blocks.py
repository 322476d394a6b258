"""BlockComparison: what two volumes that were counted block by block have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from topokit.report.report import Betti, plain
from topokit.text import printable

Known = tuple[int, None, int]


@dataclass(frozen=True)
class BlockComparison:
    """Betti numbers of a volume a and a true volume b, and the parts and cavities that match.

    All triples are (parts, tunnels, cavities), as in `Comparison`. Which tunnels match is not known: that takes cycles
    across all blocks. So it is None.

    Attributes:
        names: of a and b.
        connectivity: 6 or 26, that of both solids.
        betti_a: numbers of a.
        betti_b: numbers of b.
        matched: how many both have in common.
        dice: 2 |a ∩ b| / (|a| + |b|); 1 if both are empty.
    """

    names: tuple[str, str]
    connectivity: int
    betti_a: Betti
    betti_b: Betti
    matched: Known
    dice: float

    @property
    def betti_error(self) -> Betti:
        """|betti_a − betti_b|."""
        x, y, z = (abs(a - b) for a, b in zip(self.betti_a, self.betti_b, strict=True))
        return x, y, z

    @property
    def missing(self) -> Known:
        """What b has and a does not."""
        return self.betti_b[0] - self.matched[0], None, self.betti_b[2] - self.matched[2]

    @property
    def spurious(self) -> Known:
        """What a has and b does not."""
        return self.betti_a[0] - self.matched[0], None, self.betti_a[2] - self.matched[2]

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionaries, lists, numbers and strings, ready for JSON."""
        return plain(self) | {name: [*getattr(self, name)] for name in ("missing", "spurious", "betti_error")}

    def __str__(self) -> str:
        parts, cavities = (
            f"{name} {self.matched[k]} matched, {self.missing[k]} missing, {self.spurious[k]} spurious"
            for name, k in (("parts", 0), ("cavities", 2))
        )
        tunnels = f"tunnels {self.betti_a[1]} against {self.betti_b[1]}, not matched in blocks"
        return printable(f"{self.names[0]} against {self.names[1]}: {parts}; {tunnels}; {cavities}")
