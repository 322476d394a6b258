"""Comparison: what two solids have in common, what one of them lacks, and where."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from topokit.comparison.agreement import Agreement
from topokit.core.arrays import Floats
from topokit.core.components import Corner
from topokit.core.loops import middle, width_of
from topokit.report.location import Place
from topokit.report.report import Betti, plain
from topokit.report.wording import FEATURES, plural, position
from topokit.text import json_text, printable

if TYPE_CHECKING:
    from topokit.comparison.solids import ComparedSolids

Bounds = tuple[Corner, Corner]
Matching = Literal["invariant", "betti-matching"]
Spurious = Literal["extra part", "split part", "hole", "bridge", "bubble", "split cavity", "sealed cavity"]
Missing = Literal[
    "lost part", "merged part", "filled tunnel", "broken loop", "filled cavity", "merged cavity", "opened cavity"
]
Kind = Spurious | Missing
_MOST_LINES = 20  # differences that a text gives


@dataclass(frozen=True, eq=False)
class Difference:
    """One feature that only one of two solids has.

    Attributes:
        dimension: 0 for a part, 1 for a tunnel, 2 for a cavity.
        error: "spurious" if only a has it, "missing" if only b, the truth.
        kind: spurious is an "extra part" where b is empty, a "split part" of what is one part in the union, a "hole"
            that b fills, a "bridge" that closes a loop b does not have, a "bubble" where b is solid, a "split cavity",
            or a "sealed cavity" that is open in b. Missing is a "lost part", a "merged part", a "filled tunnel", a
            "broken loop", a "filled cavity", a "merged cavity", or an "opened cavity".
        bounds: lowest and highest corner of its box, or of that of its loop, in units of length.
        volume: of a part or cavity; None for a tunnel.
        width: diameter of the largest ball that fits, up to a step of the grid less: into the part, into the cavity, or
            for a tunnel into the region in which the solids differ at its loop; None if there is no such region.
        loop: (N, 3) points of a closed curve around a tunnel, else None.
        length: of that curve.
        cause: box of the region in which the solids differ and the feature arises, such as the gap of a broken loop;
            None where the feature as a whole is that region, or none was found.
        place: of the center in the truth's volume, by voxel and world coordinates; None for other shapes.
    """

    dimension: int
    error: Literal["missing", "spurious"]
    kind: Kind
    bounds: Bounds
    volume: float | None
    width: float | None
    loop: Floats | None = field(metadata={"json": False})
    length: float | None
    cause: Bounds | None
    place: Place | None

    @property
    def center(self) -> Corner:
        """Middle of the cause, else of the feature: where to look."""
        return middle(self.cause or self.bounds)

    def __str__(self) -> str:
        sizes = [] if self.width is None else [f"width {self.width:.3g}"]
        sizes += [] if self.length is None else [f"loop of length {self.length:.3g}"]
        sizes += [] if self.volume is None else [f"volume {self.volume:.4g}"]
        where = position(self.center, width_of(self.bounds)) if self.place is None else str(self.place)
        return f"{self.error} {self.kind} at {where}: {', '.join(sizes)}"


@dataclass(frozen=True)
class Comparison:
    """The topology of a solid a, compared with a true solid b on the same grid.

    All triples are (parts, tunnels, cavities). What matches is the dimension of im H_k(a) ∩ im H_k(b) in H_k(a ∪ b), as
    docs/comparing.md explains, unless Betti matching was asked for.

    Attributes:
        names: of a and b.
        connectivity: 6 or 26, that of both solids.
        matching: how `matched` was counted; places are always those of the invariant matching.
        resolution: step of the common grid on which two shapes were sampled; None for volumes, which are compared
            voxel by voxel.
        betti_a: numbers of a.
        betti_b: numbers of b.
        matched: how many both have in common.
        notes: sentences about what the numbers do not say, such as features that the common grid does not show.
        solids: what was compared.
    """

    names: tuple[str, str]
    connectivity: int
    matching: Matching
    resolution: float | None
    betti_a: Betti
    betti_b: Betti
    matched: Betti
    notes: tuple[str, ...]
    solids: ComparedSolids = field(repr=False, compare=False, metadata={"json": False})

    @property
    def betti_error(self) -> Betti:
        """|betti_a − betti_b|, what is usually called Betti error: 0 if numbers are equal, wherever their features."""
        x, y, z = (abs(a - b) for a, b in zip(self.betti_a, self.betti_b, strict=True))
        return x, y, z

    @property
    def missing(self) -> Betti:
        """What b has and a does not."""
        x, y, z = (b - both for b, both in zip(self.betti_b, self.matched, strict=True))
        return x, y, z

    @property
    def spurious(self) -> Betti:
        """What a has and b does not."""
        x, y, z = (a - both for a, both in zip(self.betti_a, self.matched, strict=True))
        return x, y, z

    @property
    def betti_matching_error(self) -> Betti:
        """Missing and spurious features together; unlike `betti_error` it is 0 only if all of them match."""
        x, y, z = (one + other for one, other in zip(self.missing, self.spurious, strict=True))
        return x, y, z

    @property
    def is_same(self) -> bool:
        """Whether nothing is missing and nothing is spurious, by an invariant matching."""
        return not any(self.betti_matching_error) and (
            self.matching == "invariant" or self.solids.pair.numbers.matched == self.matched
        )

    @property
    def title(self) -> str:
        """What was compared with what."""
        return f"{self.names[0]} against {self.names[1]}"

    def with_notes(self, notes: tuple[str, ...]) -> Comparison:
        """The comparison with other notes."""
        return replace(self, notes=notes)

    @cached_property
    def features(self) -> tuple[Difference, ...]:
        """Every missing and every spurious feature with its place: parts, then tunnels, then cavities.

        Of the tunnels of one kind at most 100 are located, those with short loops first.
        """
        return self.solids.differences()

    @cached_property
    def agreement(self) -> Agreement:
        """Overlap and surface distance, which say nothing about topology."""
        return self.solids.agreement()

    def to_dict(self, *, places: bool = True) -> dict[str, Any]:
        """Plain dictionaries, lists, numbers and strings, ready for JSON.

        Args:
            places: whether to look for the features and the agreement, too.
        """
        numbers = {name: [*getattr(self, name)] for name in ("missing", "spurious", "betti_error")}
        found = plain(self) | numbers | {"betti_matching_error": [*self.betti_matching_error]}
        if places:
            loops = [None if one.loop is None else one.loop.tolist() for one in self.features]
            found["features"] = [
                plain(one) | {"center": [*one.center], "loop": loop}
                for one, loop in zip(self.features, loops, strict=True)
            ]
            found["agreement"] = plain(self.agreement)
        return found

    def to_json(self, indent: int | None = None) -> str:
        """The comparison as JSON text."""
        return json_text(self.to_dict(), indent=indent)

    def text(self, *, places: bool = True) -> str:
        """The comparison as people read it: one line, and a line for each feature with its place.

        Args:
            places: whether to look for the features.
        """
        lines = [f"{self.title}: {'; '.join(self._counts())}"]
        lines += [f"  - {note}" for note in (self.notes if places else ())]
        found = self.features if places and not self.is_same else ()
        lines += [f"  - {one}" for one in found[:_MOST_LINES]]
        if len(found) > _MOST_LINES:
            lines.append(f"  … {plural(len(found) - _MOST_LINES, 'more feature')}: comparison.features")
        return "\n".join(map(printable, lines))

    def save_html(self, path: str | os.PathLike[str]) -> None:
        """Write a page: both solids in one 3D view, colored by which of them a place belongs to, and every feature.

        Args:
            path: file to write, called .html or .htm.

        Raises:
            InputError: if the file is not called so, or its folder does not exist.
        """
        from topokit.comparison.page import COLUMNS, entry_of
        from topokit.pages.document import write_html

        write_html([entry_of(self, self.title)], path, title=self.title, columns=COLUMNS)

    def __str__(self) -> str:
        return self.text(places=False)

    def _counts(self) -> list[str]:
        if self.is_same:
            both = ", ".join(plural(n, *name) for n, name in zip(self.matched, FEATURES, strict=True))
            return [f"the same topology, {both}"]
        rows = zip(FEATURES, self.matched, self.missing, self.spurious, strict=True)
        return [f"{many} {both} matched, {less} missing, {more} spurious" for (_, many), both, less, more in rows]
