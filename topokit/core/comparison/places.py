"""Where two solids on one grid differ in topology: boxes, widths and loops."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy import ndimage

from topokit.core.arrays import Booleans, Floats
from topokit.core.comparison.cells import FIRST, SECOND
from topokit.core.comparison.loops import differing_loops
from topokit.core.comparison.pair import SolidPair
from topokit.core.comparison.regions import Labels, MatchedRegions, smallest_links
from topokit.core.grid.grid import Spacing

Box = tuple[slice, ...]
How = Literal["filled", "absent", "alone", "divided", "outside"]
"""What the other solid has in place of a feature: it fills a tunnel; it has no such loop; it has no such region; there
it is one region with another one; there it is part of the outside."""

_EVERY_NEIGHBOR = np.ones((3, 3, 3), bool)


@dataclass(frozen=True, eq=False)
class Found:
    """A feature of one solid that the other one does not have.

    Attributes:
        dimension: 0 for a part, 1 for a tunnel, 2 for a cavity.
        side: 0 if the first solid has it, 1 if the second.
        how: what the other one has in place of it.
        box: voxels that hold it, in the grid; of a tunnel, those that its loop passes.
        n_voxels: of the part or cavity; None for a tunnel.
        width: diameter of the largest ball in the part or cavity, or of a tunnel in the region where it arises.
        loop: (N, 3) of a tunnel, in steps of the grid; None for others.
        cause: voxels that hold the region in which the solids differ so that the feature arises, if that was found.
    """

    dimension: int
    side: int
    how: How
    box: Box
    n_voxels: int | None
    width: float | None
    loop: Floats | None
    cause: Box | None


class Places:
    """Finds the places of everything in which two solids differ.

    Attributes:
        pair: the solids.
        spacing: of the grid.
    """

    def __init__(self, pair: SolidPair, spacing: Spacing) -> None:
        self.pair, self.spacing = pair, spacing
        self._solids = pair.first, pair.second

    def parts(self, side: int) -> Iterator[Found]:
        """The parts of one solid that are surplus."""
        yield from self._regions(0, side, self.pair.parts, 1 - side)

    def cavities(self, side: int) -> Iterator[Found]:
        """The cavities of one solid that are surplus."""
        yield from self._regions(2, side, self.pair.cavities, side)

    def tunnels(self, side: int, most: int) -> Iterator[Found]:
        """The tunnels of one solid that are surplus, at most so many of each kind."""
        numbers = self.pair.numbers
        if (numbers.first, numbers.second)[side][1] == numbers.matched[1]:
            return
        for found in differing_loops(self.pair.complex, (FIRST, SECOND)[side], most):
            low, high = np.floor(found.vertices.min(0)).astype(int), np.ceil(found.vertices.max(0)).astype(int) + 1
            ends = zip(low.tolist(), high.tolist(), self.pair.first.shape, strict=True)
            box = tuple(slice(max(0, a), min(b, n)) for a, b, n in ends)
            width, cause = self._cause(side, found.kind, box)
            loop = found.vertices + self.pair.corner
            yield Found(1, side, found.kind, self._in_grid(box), None, width, loop, cause)

    @cached_property
    def _only(self) -> tuple[Labels, Labels]:
        """Labels of the regions of one solid without the other."""
        one, other = self._solids
        first, second = (ndimage.label(mask, structure=_EVERY_NEIGHBOR)[0] for mask in (one & ~other, other & ~one))
        return first, second

    @cached_property
    def _only_boxes(self) -> tuple[list[Any], list[Any]]:
        first, second = (ndimage.find_objects(labels) for labels in self._only)
        return first, second

    def _regions(self, dimension: int, side: int, found: MatchedRegions, filling: int) -> Iterator[Found]:
        labels, shift = found.labels[side], found.n_outside
        if not len(surplus := found.unmatched(side)):
            return
        boxes, gaps = ndimage.find_objects(labels), smallest_links(np.pad(self._only[filling], shift), labels)
        outside = int(labels.flat[0]) if found.n_outside else 0
        for label in surplus.tolist():
            box = boxes[label - 1]
            own = labels[box] == label
            how: How = "divided" if found.is_shared(side, label) else "alone"
            if how == "divided" and outside and found.classes[side][label] == found.classes[side][outside]:
                how = "outside"
            gap = gaps.get(label) if how != "alone" else None
            yield Found(
                dimension,
                side,
                how,
                self._in_grid(box, shift),
                int(own.sum()),
                self._width(np.pad(own, 1), np.pad(own, 1)),
                None,
                None if gap is None else self._in_grid(self._only_boxes[filling][gap - 1]),
            )

    def _cause(self, side: int, kind: str, box: Box) -> tuple[float | None, Box | None]:
        """The width of the region in which a tunnel arises, and its box: the widest one within the box of its loop."""
        filling = side if kind == "absent" else 1 - side
        around = _widened(box, 1, self.pair.first.shape)
        regions = self._only[filling][around]
        if not regions.any():
            return None, None
        wide = _widened(box, 3, self.pair.first.shape)
        phase = np.pad(self._solids[side][wide] == (kind == "absent"), 1)
        own = np.pad(self._only[filling][wide], 1)
        inner = np.zeros(phase.shape, bool)
        inner[tuple(slice(1 + a.start - w.start, 1 + a.stop - w.start) for a, w in zip(around, wide, strict=True))] = 1
        depth = np.where(inner & (own > 0), ndimage.distance_transform_edt(phase, self.spacing), 0)
        number = int(own.flat[int(depth.argmax())])
        return self._diameter(float(depth.max())), self._in_grid(self._only_boxes[filling][number - 1])

    def _width(self, phase: Booleans, where: Booleans) -> float:
        """Diameter of the largest ball in a phase whose center is in some voxels."""
        return self._diameter(float(ndimage.distance_transform_edt(phase, self.spacing)[where].max()))

    def _diameter(self, distance: float) -> float:
        """Of a ball, from the distance of its center to the nearest center of a voxel beyond."""
        return 2 * distance - min(self.spacing)

    def _in_grid(self, box: Box, shift: int = 0) -> Box:
        return tuple(
            slice(side.start + start - shift, side.stop + start - shift)
            for side, start in zip(box, self.pair.corner, strict=True)
        )


def _widened(box: Box, by: int, shape: tuple[int, ...]) -> Box:
    return tuple(slice(max(0, side.start - by), min(n, side.stop + by)) for side, n in zip(box, shape, strict=True))
