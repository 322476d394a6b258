"""What was done to a shape to remove its narrow features, as a table."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from topokit.core.removal import Removal
from topokit.report.report import Betti
from topokit.report.wording import plural, position

Unit = Literal["voxel", "face"]


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
    """

    below: float
    removals: tuple[Removal, ...]
    before: Betti
    after: Betti
    changed: int
    unit: Unit
    filled: int = 0

    def summary(self) -> str:
        """The numbers before and after, in one sentence, or that nothing was removed."""
        names = ("piece", "pieces"), ("tunnel", "tunnels"), ("cavity", "cavities")
        after = ", ".join(plural(count, *name) for count, name in zip(self.after, names, strict=True))
        before = ", ".join(map(str, self.before))
        filled = f"{plural(self.filled, 'boundary loop')} filled. " if self.filled else ""
        if not self.removals:
            return f"{filled}Nothing below {self.below:.4g} was found that may be removed: {after}."
        changed = f"{plural(self.changed, self.unit)} changed"
        return f"{filled}Simplified below {self.below:.4g}: {after} (before: {before}), {changed}."

    def text(self) -> str:
        """The summary, and a line for each removal."""
        rows = [("what", "how", "width", "place", f"{self.unit}s")]
        for one in self.removals:
            place = position(one.place, one.width)
            rows.append((one.kind, one.how, f"{one.width:.3g}", place, str(one.changed)))
        sizes = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(text.ljust(size) for text, size in zip(row, sizes, strict=True)).rstrip() for row in rows]
        return "\n".join([self.summary(), *(f"  {line}" for line in lines if self.removals)])

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as for JSON."""
        return asdict(self)
