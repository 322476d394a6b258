"""What was done to a shape to remove its narrow features, as a table."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

from topokit.core.components import Corner
from topokit.core.removal import Kind, Removal
from topokit.report.report import Betti
from topokit.report.wording import plural, position

Unit = Literal["voxel", "face"]
_MOST_LISTED = 20  # places that are not settled


@dataclass(frozen=True)
class Unsettled:
    """A narrow place of a volume in blocks which may be a feature or not, depending on what is farther away.

    Attributes:
        kind: "part", "tunnel" or "cavity": what it would be.
        width: in units of length.
        place: its center.
    """

    kind: Kind
    width: float
    place: Corner


@dataclass(frozen=True)
class Simplification:
    """What `Shape.simplify` removed.

    Attributes:
        below: width below which features were removed, in units of length.
        removals: narrowest first.
        before: (pieces, tunnels, cavities) of the solid.
        after: the same of the result, which was counted.
        changed: voxels that joined or left the solid, or faces that were added.
        unit: what `changed` counts.
        filled: boundary loops of a mesh that were filled first.
        unsettled: narrow places of a volume in blocks that were left because no block shows whether they are features,
            narrowest first.
        narrowest: width of the narrowest feature that was seen and stays, as far as the search came: loops of a mesh up
            to four widths around; in volumes those up to a voxel wider than asked, of which it is a lower bound.
    """

    below: float
    removals: tuple[Removal, ...]
    before: Betti
    after: Betti
    changed: int
    unit: Unit
    filled: int = 0
    unsettled: tuple[Unsettled, ...] = ()
    narrowest: float | None = None

    @classmethod
    def of(
        cls,
        below: float,
        removals: Iterable[Removal],
        before: Betti,
        after: Betti,
        changed: int,
        unit: Unit,
        narrowest: float,
        unsettled: Iterable[Unsettled] = (),
    ) -> Simplification:
        """The table of what was found in any order; `narrowest` is infinite if nothing that stays was seen."""
        done = tuple(sorted(removals, key=lambda one: (one.width, one.place)))
        left = tuple(sorted(unsettled, key=lambda one: (one.width, one.place)))
        seen = narrowest if narrowest < math.inf else None
        return cls(below, done, before, after, changed, unit, unsettled=left, narrowest=seen)

    def summary(self) -> str:
        """The numbers before and after, in one sentence, or that nothing was removed."""
        names = ("piece", "pieces"), ("tunnel", "tunnels"), ("cavity", "cavities")
        after = ", ".join(plural(count, *name) for count, name in zip(self.after, names, strict=True))
        before = ", ".join(map(str, self.before))
        filled = f"{plural(self.filled, 'boundary loop')} filled. " if self.filled else ""
        left = f" {plural(len(self.unsettled), 'narrow place')} not settled in a block." if self.unsettled else ""
        if not self.removals:
            seen = f" The narrowest that was seen is {self.narrowest:.3g} wide." if self.narrowest else ""
            return f"{filled}Nothing below {self.below:.4g} was found that may be removed: {after}.{seen}{left}"
        changed = f"{plural(self.changed, self.unit)} changed"
        return f"{filled}Simplified below {self.below:.4g}: {after} (before: {before}), {changed}.{left}"

    def text(self) -> str:
        """The summary, and a line for each removal, and for each of the first places that are not settled."""
        rows = [("what", "how", "width", "place", f"{self.unit}s")]
        for one in self.removals:
            place = position(one.place, one.width)
            rows.append((one.kind, one.how, f"{one.width:.3g}", place, str(one.changed)))
        for other in self.unsettled[:_MOST_LISTED]:
            rows.append((other.kind, "not settled", f"{other.width:.3g}", position(other.place, other.width), "0"))
        sizes = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(text.ljust(size) for text, size in zip(row, sizes, strict=True)).rstrip() for row in rows]
        return "\n".join([self.summary(), *(f"  {line}" for line in lines if len(rows) > 1)])

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as for JSON."""
        return asdict(self)
