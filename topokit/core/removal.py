"""What is removed when features of a solid are too narrow: each with its place, width and the way it went."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from topokit.core.components import Corner

Kind = Literal["part", "tunnel", "cavity"]
How = Literal["dropped", "joined", "cut", "filled", "opened"]

KINDS: tuple[Kind, ...] = ("part", "tunnel", "cavity")
"""In the order of Betti numbers."""


@dataclass(frozen=True)
class Removal:
    """A part, tunnel or cavity that was removed.

    Attributes:
        kind: "part", "tunnel" or "cavity".
        how: a part is "dropped" or "joined" to another one, a tunnel "filled" or its handle "cut", a cavity "filled" or
            its wall "opened".
        width: of the narrowest place, in units of length.
        place: its center.
        changed: voxels or faces that were changed for it, and for those that share them.
    """

    kind: Kind
    how: How
    width: float
    place: Corner
    changed: int
