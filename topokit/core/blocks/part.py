"""A box of a volume as what the boxes around it need to know: its regions, their walls, and labels on its six faces.

Parts are joined two by two across a face, in any order, until one part is the whole volume. What is counted in a part
never changes again, so a part needs no memory for voxels inside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.cubes import cube_tables
from topokit.core.blocks.division import Box, Triple
from topokit.core.blocks.planes import gather_nodes, join_planes, label_plane, number_roots, write_dense, write_runs
from topokit.errors import InputError

Labels = NDArray[np.int32]
Periodic = tuple[bool, bool, bool]
"""For each axis, whether the last layer of a box touches the first."""

NOT_PERIODIC: Periodic = (False, False, False)

NODE_COLUMNS = ("size", "first", "low x", "low y", "low z", "high x", "high y", "high z")
"""Of a region: number of voxels, flat index of the first one in the volume, and the box (first and last + 1)."""

PLACES = 1 << 12  # pairs of regions whose sums are kept at hand while voxels are counted
_MOST_FULL = (
    1 << 17
)  # cubes between two planes that are joined at once: bounds the memory for sums that lose their place

_MOST_NODES = np.iinfo(np.int32).max - 1  # regions before they are united; labels are ± numbers of 32 bits


class Faces(NamedTuple):
    """Labels (n, m) of the first and of the last layer of a box across one axis; the other axes keep their order."""

    low: Labels
    high: Labels


class Runs(NamedTuple):
    """A plane (n, m) as runs of equal labels along its rows: label and stop (last + 1) where each starts."""

    labels: Labels
    stops: Labels

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> Runs:
        """Room for the runs of a plane."""
        return cls(np.empty(shape, np.int32), np.empty(shape, np.int32))

    @classmethod
    def of(cls, dense: Labels) -> Runs:
        """The runs of a plane of labels."""
        labels, stops = np.array(dense, order="C"), np.empty(dense.shape, np.int32)  # arrays sent here are read-only
        write_runs(labels, stops)
        return cls(labels, stops)


@dataclass(frozen=True, eq=False)
class Part:
    """A box of a volume, counted.

    Attributes:
        nodes: (N, 8), a row of `NODE_COLUMNS` for each region of either phase.
        is_six: (N,), whether the region is in the 6-connected phase.
        walls: (W, 6), a row for each pair of regions that touch: the one of the 6-connected phase, the other one, and
            the sums of the four `CubeTables.weights` over the cubes inside the box.
        dual: sum of `CubeTables.dual`.
        faces: of each axis; labels are ± (row of `nodes` + 1), positive in the 6-connected phase.
    """

    nodes: Integers
    is_six: Booleans
    walls: Integers
    dual: int
    faces: tuple[Faces, ...]

    def without_faces(self) -> Part:
        """The part as far as it is counted, without what only joining needs."""
        return replace(self, faces=())


def count_part(is_six: Booleans, place: Triple, shape: Triple, labels: Labels | None = None) -> Part:
    """The part of one block.

    Args:
        is_six: (X, Y, Z), whether a voxel is in the 6-connected phase.
        place: position of its first voxel in the volume.
        shape: of the volume.
        labels: (X, Y, Z), where the labels of all voxels are written, as those of `Part.faces`; None if not wanted.
    """
    forest = _Forest()
    n_x, n_y, n_z = is_six.shape
    faces = tuple(Faces(np.empty(n, np.int32), np.empty(n, np.int32)) for n in ((n_y, n_z), (n_x, n_z), (n_x, n_y)))
    dense = faces[0].high  # always that of the last layer so far
    # Used in turn: fresh memory for every plane costs as much as counting it.
    before, runs = Runs.empty((n_y, n_z)), Runs.empty((n_y, n_z))
    wide = np.zeros((n_y, -(-n_z // 8) * 8), bool)
    for x, plane in enumerate(is_six):
        wide[:, :n_z] = plane
        forest.label(wide, (place[0] + x, place[1], place[2]), shape, runs)
        if x > 0:
            forest.join(before, runs)
        write_dense(*runs, dense)
        if labels is not None:
            labels[x] = dense
        if x == 0:
            faces[0].low[:] = dense
        faces[1].low[x], faces[1].high[x] = dense[0], dense[-1]
        faces[2].low[x], faces[2].high[x] = dense[:, 0], dense[:, -1]
        before, runs = runs, before
    part, numbers = forest.part(faces)
    if labels is not None:
        labels[:] = _signed(numbers)[labels + len(numbers)]
    return part


def count_box(inside: Booleans, box: Box, shape: Triple, connectivity: int, periodic: Periodic = NOT_PERIODIC) -> Part:
    """The part of one block of a volume, with the layer of background beyond each face that it shares with the volume.

    Args:
        inside: (X, Y, Z), whether a voxel of the block is in the solid.
        box: of the block in the volume, first and last + 1 voxel along each axis.
        shape: of the volume.
        connectivity: 6 or 26, that of the solid.
        periodic: axes without such layers.
    """
    return count_part(*_with_background(inside, box, shape, connectivity, periodic))


def count_labeled_box(inside: Booleans, box: Box, shape: Triple, connectivity: int) -> tuple[Part, Labels]:
    """As `count_box`; with the labels of the block and of that layer, positive in the 6-connected phase."""
    is_six, place, whole = _with_background(inside, box, shape, connectivity, NOT_PERIODIC)
    labels = np.empty(is_six.shape, np.int32)
    return count_part(is_six, place, whole, labels), labels


def _with_background(
    inside: Booleans, box: Box, shape: Triple, connectivity: int, periodic: Periodic
) -> tuple[Booleans, Triple, Triple]:
    """A block with its layers of background, its place, and the shape of the volume with them."""
    layers = [int(not wraps) for wraps in periodic]  # at either end of the volume
    first_layers = [layer * (start == 0) for layer, (start, _) in zip(layers, box, strict=True)]
    last_layers = [layer * (stop == n) for layer, (_, stop), n in zip(layers, box, shape, strict=True)]
    x, y, z = (start + layer - before for (start, _), layer, before in zip(box, layers, first_layers, strict=True))
    n_x, n_y, n_z = (n + 2 * layer for n, layer in zip(shape, layers, strict=True))
    background_is_six = connectivity == 26
    sides = zip(first_layers, inside.shape, last_layers, strict=True)
    is_six = np.full([before + n + after for before, n, after in sides], background_is_six)
    within = is_six[tuple(slice(before, before + n) for before, n in zip(first_layers, inside.shape, strict=True))]
    np.not_equal(inside, background_is_six, out=within)
    return is_six, (x, y, z), (n_x, n_y, n_z)


def join_parts(one: Part, other: Part, axis: int) -> Part:
    """The part of two boxes that lie side by side.

    Args:
        one: the box that comes first along the axis.
        other: the next one, of the same size and place along the other axes.
        axis: 0, 1 or 2.
    """
    return joined_and_numbers(one, other, axis)[0]


def joined_and_numbers(one: Part, other: Part, axis: int) -> tuple[Part, Labels]:
    """As `join_parts`; with the new number of each region of one part, and then of those of the other."""
    forest = _Forest()
    moved = _renumbered(other, np.arange(len(other.nodes)) + len(one.nodes))
    forest.add(one)
    forest.add(moved)
    forest.join(Runs.of(one.faces[axis].high), Runs.of(moved.faces[axis].low), axis)
    faces = []
    for number, (mine, theirs) in enumerate(zip(one.faces, moved.faces, strict=True)):
        if number == axis:
            faces.append(Faces(mine.low, theirs.high))
        else:
            along = axis - (axis > number)  # the axis of joining among those of the face
            faces.append(Faces(*(np.concatenate(ends, along) for ends in zip(mine, theirs, strict=True))))
    return forest.part(tuple(faces))


class _Forest:
    """The regions found so far as a union-find forest, with all that is known of them."""

    def __init__(self) -> None:
        self._parents = np.empty(0, np.int32)
        self._nodes = np.empty((0, len(NODE_COLUMNS)), np.int64)
        self._is_six = np.empty(0, bool)
        self._n_nodes = 0
        self._sums = np.full((PLACES, 6), -1, np.int64)
        self._full = np.empty((0, 6), np.int64)
        self._walls: list[Integers] = []
        self._dual = 0

    def add(self, part: Part) -> None:
        """Take over what a part knows; its nodes become the next ones."""
        self._reserve(len(part.nodes))
        new = slice(self._n_nodes, self._n_nodes + len(part.nodes))
        self._nodes[new], self._is_six[new] = part.nodes, part.is_six
        self._parents[new] = np.arange(new.start, new.stop)
        self._walls.append(part.walls)
        self._n_nodes, self._dual = new.stop, self._dual + part.dual

    def label(self, is_six: Booleans, place: Triple, shape: Triple, runs: Runs) -> None:
        """Label the next plane of a block, its rows filled up to a multiple of 8, and write its runs."""
        self._reserve(is_six.size)
        where = np.array(place), np.array(shape)
        n = runs.labels.shape[1]
        self._n_nodes = label_plane(
            is_six, n, *where, self._parents, self._nodes, self._is_six, self._n_nodes, runs.labels, runs.stops
        )

    def join(self, lower: Runs, upper: Runs, axis: int = 0) -> None:
        """Join two planes that lie face to face along an axis."""
        n_rows, n = lower.labels.shape
        strip = max(1, min(_MOST_FULL // n, n_rows))
        if len(self._full) < 8 * strip * n:
            self._full = np.empty((8 * strip * n, 6), np.int64)
        walls, sums = [], self._sums
        pieces, weights, dual_weights = cube_tables()
        for start in range(0, n_rows - 1, strip):
            rows = slice(start, start + strip + 1)
            a, b = Runs(lower.labels[rows], lower.stops[rows]), Runs(upper.labels[rows], upper.stops[rows])
            n_full, dual = join_planes(*a, *b, self._parents, pieces, weights, dual_weights, sums, self._full)
            walls.append(self._full[:n_full].copy())
            self._dual += dual
        if axis > 0:  # crossings along the axis of joining come first
            walls = [np.concatenate((*walls, sums[sums[:, 0] >= 0]))]
            walls[0][:, 3 : 4 + axis] = np.roll(walls[0][:, 3 : 4 + axis], -1, 1)
            sums[:, 0] = -1
        self._walls += walls

    def part(self, faces: tuple[Faces, ...]) -> tuple[Part, Labels]:
        """All that was found, with regions numbered anew, and the new number of each node."""
        numbers = np.empty(self._n_nodes, np.int32)
        n_regions = number_roots(self._parents[: self._n_nodes], numbers)
        nodes = np.empty((n_regions, len(NODE_COLUMNS)), np.int64)
        gather_nodes(self._nodes[: self._n_nodes], numbers, nodes)
        is_six = np.empty(n_regions, bool)
        is_six[numbers] = self._is_six[: self._n_nodes]
        walls = np.concatenate((*self._walls, self._sums[self._sums[:, 0] >= 0]))
        return _renumbered(Part(nodes, is_six, walls, self._dual, faces), numbers), numbers

    def _reserve(self, n_more: int) -> None:
        """Make room for more nodes."""
        if self._n_nodes + n_more > _MOST_NODES:
            raise InputError(
                f"a box of the volume has more than {self._n_nodes} regions, counted with those that join later, and "
                f"{_MOST_NODES} are the most: smooth away the noise, or count parts of the volume."
            )
        missing = self._n_nodes + n_more - len(self._parents)
        if missing > 0:
            missing = max(2 * n_more, len(self._parents))  # so that copies are rare
            self._parents = np.concatenate((self._parents, np.empty(missing, np.int32)))
            self._is_six = np.concatenate((self._is_six, np.empty(missing, bool)))
            self._nodes = np.concatenate((self._nodes, np.empty((missing, len(NODE_COLUMNS)), np.int64)))


def _renumbered(part: Part, numbers: Integers | Labels) -> Part:
    """The part with other numbers of its regions in walls and faces; walls between the same regions become one."""
    signed = _signed(numbers)
    faces = tuple(Faces(*(signed[labels + len(numbers)] for labels in ends)) for ends in part.faces)
    walls = part.walls.copy()
    walls[:, :2] = numbers[part.walls[:, :2]]
    return replace(part, walls=summed_walls(walls), faces=faces)


def _signed(numbers: Integers | Labels) -> Labels:
    """The new labels of labels −N … N, as N is added to them."""
    return np.concatenate((-1 - numbers[::-1], (0,), numbers + 1)).astype(np.int32)


def summed_walls(walls: Integers) -> Integers:
    """One row for each pair of regions."""
    if not len(walls):
        return walls
    walls = walls[np.lexsort((walls[:, 1], walls[:, 0]))]
    is_first = np.ones(len(walls), bool)
    is_first[1:] = (walls[1:, :2] != walls[:-1, :2]).any(1)
    starts = np.flatnonzero(is_first)
    return np.concatenate((walls[starts, :2], np.add.reduceat(walls[:, 2:], starts)), axis=1)
