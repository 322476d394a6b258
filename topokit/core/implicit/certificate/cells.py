"""The octree of a proof: cells that hold no surface are left out, cells in which the surface is a graph are kept."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain, product, repeat
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.components import Corner
from topokit.core.implicit.bounds.gradients import Zonotopes, count_kinks, gradients
from topokit.core.implicit.bounds.local import local_networks
from topokit.core.implicit.bounds.nested import nested, restricted
from topokit.core.implicit.bounds.program import Form, Program
from topokit.core.implicit.bounds.rounding import STEP
from topokit.core.processors import n_cores, one_thread

DEEPEST = 17  # halvings of the first cells: to 1/524 288 of the box's longest side
_ROOT = 4  # first cells along the longest side
_MOST_KINKS = 48  # in a cell of which the gradient is bounded; with more it is divided at once
_MOST_CREASES = 8  # in a cell for which a direction is searched
_MOST_LOCAL = 96  # in a cell whose own network is made
_LOOK = 4  # halvings of a cell by its own network
_MOST_CELLS = 1 << 24  # of one size; their parents take 50 MB
_ENTRIES = 1 << 15  # numbers in a vector of all cells that are bounded together
_SIDE_BY_SIDE = 16  # such sets of cells between two looks at what was spent: on any number of cores
_LINEAR, _CURVED, _KINK, _LOCAL = 20, 120, 4, 10
"""Evaluations of the function that take as long as bounding a cell of ReLUs alone, one of curves, every kink in it, and
a cell by the network of a larger one."""

OFFSETS = np.array(list(product((0, 1), repeat=3)))
"""(8, 3) the children of a cell, and its corners."""


@dataclass(frozen=True, eq=False)
class Leaves:
    """Cells in which the gradient keeps to one side of a plane, so that the level set is a graph or empty.

    Attributes:
        index: (n, 3) position among the cells of the same size.
        level: (n,) how often the first cells were halved.
        gradient: enclosures of the gradient, n sets.
    """

    index: Integers
    level: Integers
    gradient: Zonotopes

    def rows(self, chosen: Integers) -> Leaves:
        """Some of them, by ascending number."""
        return Leaves(self.index[chosen], self.level[chosen], self.gradient.rows(torch.from_numpy(chosen)))

    @staticmethod
    def joined(parts: Sequence[Leaves]) -> Leaves:
        """Several collections as one."""
        gradient = Zonotopes.joined([part.gradient for part in parts])
        return Leaves(
            np.concatenate([part.index for part in parts]), np.concatenate([part.level for part in parts]), gradient
        )


@dataclass(frozen=True)
class Effort:
    """What a proof may cost.

    Attributes:
        seconds: after which no cell is divided any more.
        evaluations: of the function that take as long: a limit that does not depend on the machine.
    """

    seconds: float = math.inf
    evaluations: float = math.inf


class Found(NamedTuple):
    """What was found in cells: leaves, and cells that are undecided, with their level; and what it took."""

    leaves: Leaves
    undecided: Integers
    level: int
    n_bounded: int = 0
    cost: int = 0  # in evaluations of the function


class Octree:
    """Cells of a box and what is proven about a function in them.

    Args:
        program: the function, whose level set is at 0.
        low: lowest corner of the box.
        high: highest corner.
        effort: what it may cost.
    """

    def __init__(self, program: Program, low: Corner, high: Corner, effort: Effort) -> None:
        self.program, self.effort = program, effort
        self.deadline = time.monotonic() + effort.seconds
        self.low, self.side = np.array(low), np.array(high) - np.array(low)
        self.root = np.maximum(1, np.rint(_ROOT * self.side / self.side.max())).astype(np.int64)
        self.n_bounded = 0
        self.cost = 0  # in evaluations of the function
        self.deepest = 0
        self.open: list[tuple[Integers, int]] = []  # cells that stay undecided, with their level
        self._per_cell = _LINEAR if program.is_piecewise_linear else _CURVED
        self._chunk = max(64, _ENTRIES // max(program.widths))

    def start(self) -> Leaves:
        """The leaves of the whole box."""
        cells = np.array(list(product(*map(range, self.root.tolist()))), dtype=np.int64)
        return self._search(cells, 0)

    def divide(self, cells: Integers, level: int) -> Leaves:
        """The leaves inside of some cells, breadth first; what stays undecided is added to `open`.

        Args:
            cells: (n, 3), of one level.
            level: theirs.
        """
        return self._search(cells, level + 1)

    def _search(self, cells: Integers, level: int) -> Leaves:
        """The leaves among the cells of a level: the first ones (n, 3), or the children of n cells."""
        found: list[Leaves] = [_none()]
        waiting = {level: [cells]}  # what is to be divided: an eighth of what will be bounded
        with ThreadPoolExecutor(n_cores()) as threads:
            while waiting:
                level = min(waiting)
                cells = np.concatenate(waiting.pop(level))
                each = 8 if level else 1
                together = _SIDE_BY_SIDE * self._chunk // each
                for start in range(0, len(cells), together):
                    if self.is_over(each * (len(cells) - start)) or each * len(cells) > _MOST_CELLS:
                        self.open.append((cells[start:], max(level - 1, 0)))
                        break
                    part = cells[start : start + together]
                    part = children(part) if level else part
                    parts = [part[k : k + self._chunk] for k in range(0, len(part), self._chunk)]
                    for one in chain(*threads.map(self._leaves_in, parts, repeat(level))):
                        found.append(one.leaves)
                        self.n_bounded += one.n_bounded
                        self.cost += one.cost
                        self.deepest = max(self.deepest, one.level)
                        if len(one.undecided) and one.level == DEEPEST:
                            self.open.append((one.undecided, one.level))
                        elif len(one.undecided):
                            waiting.setdefault(one.level + 1, []).append(one.undecided)
        return Leaves.joined(found)

    def is_over(self, n_cells: int = 0) -> bool:
        """Whether so many cells more cannot be bounded any more."""
        return self._is_late() or self.cost + self._per_cell * n_cells > self.effort.evaluations

    def _is_late(self) -> bool:
        return time.monotonic() > self.deadline

    def bounds(self, cells: Integers, level: int) -> tuple[Floats, Floats]:
        """(n, 3) lowest and highest corners of cells."""
        size = self.side / (self.root * 2.0**level)
        return self.low + cells * size, self.low + (cells + 1) * size

    def touched(self, cells: Integers, level: Integers | int) -> Booleans:
        """(n, 3) whether cells touch the box's faces across each axis."""
        last = self.root * (1 << np.asarray(level, dtype=np.int64))[..., None] - 1
        touches: Booleans = (cells == 0) | (cells == last)
        return touches

    def values(self, points: Floats) -> Floats:
        """(n,) the function at points (n, 3), in double precision."""
        parts = torch.from_numpy(points).split(4 * self._chunk)
        return np.concatenate([np.zeros(0), *(self.program.values(part)[:, 0].numpy() for part in parts)])

    def bounded_values(self, points: Floats) -> tuple[Floats, Floats]:
        """The function at points (n, 3): values (n,) and bounds of their errors (n,)."""
        found, errors = [np.zeros(0)], [np.zeros(0)]
        for part in torch.from_numpy(points).split(4 * self._chunk):
            form = self.program.forms(part, part[:0])[-1]
            found.append(form.center[:, 0].numpy())
            errors.append(form.reach[:, 0].numpy())
        return np.concatenate(found), np.concatenate(errors)

    def _leaves_in(self, cells: Integers, level: int) -> list[Found]:
        with one_thread():
            return list(self._found_in(cells, level))

    def _found_in(self, cells: Integers, level: int) -> Iterator[Found]:
        """What is in cells, by the whole program; and in those with few kinks also by networks of their own."""
        centers, half = self._boxes(cells, level)
        forms = self.program.forms(centers, half.expand_as(centers))
        cost = self._per_cell * len(cells) + _KINK * len(forms[-1].owner)
        low, high = (end[:, 0] for end in forms[-1].ends)
        kinks = count_kinks(self.program, forms)
        undecided = (~((low > 0) | (high < 0))).nonzero()[:, 0]
        chosen = undecided[kinks[undecided] <= _MOST_KINKS]
        gradient = gradients(self.program, [form.rows(chosen) for form in forms])
        center = self.program.forms(centers[chosen], centers[:0])[-1]
        nearest = center.center[:, 0].abs() - center.reach[:, 0]
        is_empty = nearest > (gradient.size * half).sum(1) * (1 + 1e-10)
        is_graph = self._is_graph(gradient, cells[chosen.numpy()], level) & ~is_empty
        found = self._leaves(cells[chosen.numpy()], level, gradient, is_graph)
        yield Found(found, cells[:0], level, len(cells), cost)
        rest = undecided[~torch.isin(undecided, chosen[is_empty | is_graph])]
        is_local = kinks[rest] <= (_MOST_LOCAL if self.program.is_piecewise_linear and level < DEEPEST else -1)
        yield Found(_none(), cells[rest[~is_local].numpy()], level)
        if is_local.any():
            forms = [form.rows(rest[is_local]) for form in forms]
            yield from self._descended(cells[rest[is_local].numpy()], level, forms, half.numpy())

    def _descended(self, cells: Integers, level: int, forms: list[Form], half: Floats) -> Iterator[Found]:
        """What is in the cells inside of some, by the networks of these."""
        networks, origin = local_networks(self.program, forms), cells
        slack = 64 * STEP * (np.abs(self.low) + self.side).max() / half
        for depth in range(1, _LOOK + 1):
            cells, network, level = children(cells), np.repeat(np.arange(len(cells)), 8), level + 1
            n_bounded = len(cells)
            offset = ((2 * cells + 1) * 0.5**depth - (2 * origin[network] + 1)).astype(np.float64)
            found = nested(networks, network, offset, 0.5**depth + slack)
            undecided = np.nonzero(found.sign == 0)[0]
            gradient = found.gradient(undecided, half)
            is_graph = self._is_graph(gradient, cells[undecided], level)
            leaves = self._leaves(cells[undecided], level, gradient, is_graph)
            yield Found(leaves, cells[:0], level, n_bounded, _LOCAL * n_bounded)
            rest = undecided[~is_graph.numpy()]
            cells = cells[rest]
            if not len(rest) or level == DEEPEST or depth == _LOOK or self._is_late():
                break
            networks, origin = restricted(networks, network[rest], found.state[rest]), origin[network[rest]]
        yield Found(_none(), cells, level)

    def _leaves(self, cells: Integers, level: int, gradient: Zonotopes, is_leaf: Tensor) -> Leaves:
        rows = is_leaf.nonzero()[:, 0]
        return Leaves(cells[rows.numpy()], np.full(len(rows), level), gradient.rows(rows))

    def _boxes(self, cells: Integers, level: int) -> tuple[Tensor, Tensor]:
        """(n, 3) centers, and (3,) half sides that cover their rounding."""
        scale = self.side / (self.root * 2.0 ** (level + 1))
        centers = torch.from_numpy(self.low + (2 * cells + 1) * scale)
        return centers, torch.from_numpy(scale * (1 + STEP) + STEP * (np.abs(self.low) + self.side))

    def _is_graph(self, gradient: Zonotopes, cells: Integers, level: int) -> Tensor:
        touched = torch.from_numpy(self.touched(cells, level))
        found = rises(gradient, gradient.center[:, None], touched)
        n_kinks = torch.bincount(gradient.owner, minlength=len(found))
        creased = (~found & ~touched.any(1) & (n_kinks > 0) & (n_kinks <= _MOST_CREASES)).nonzero()[:, 0]
        sets = gradient.rows(creased)
        found[creased] = sets.least(sets.shortest()[:, None])[:, 0] > 0
        return found


def _none() -> Leaves:
    empty = torch.zeros(0, 3, dtype=torch.float64)
    nothing = Zonotopes(empty, empty, torch.zeros(0, dtype=torch.int64), empty)
    return Leaves(np.zeros((0, 3), np.int64), np.zeros(0, np.int64), nothing)


def rises(gradient: Zonotopes, directions: Tensor, touched: Tensor, slack: Tensor | None = None) -> Tensor:
    """Whether the function rises along directions, and along their projections to the faces of the box that are near.

    Args:
        gradient: N sets.
        directions: (N, J, 3), J for each.
        touched: (N, 3) whether the cell touches a face of the box across each axis.
        slack: (N, J, 3) bounds of the errors of the directions, which are exact without.

    Returns:
        (N,) whether all do.
    """
    needed = torch.zeros(()) if slack is None else (slack * gradient.size[:, None]).sum(2)
    found = (gradient.least(directions) > needed).all(1)
    at_faces = (touched.any(1) & found).nonzero()[:, 0]
    if len(at_faces):
        part, near, along = gradient.rows(at_faces), touched[at_faces], directions[at_faces]
        needed = needed if slack is None else needed[at_faces]
        for crossed in product((False, True), repeat=3):
            axes = torch.tensor(crossed)
            if any(crossed):
                applies = (near | ~axes).all(1)
                is_above = (part.least(along.masked_fill(axes, 0.0)) > needed).all(1)
                found[at_faces] &= is_above | ~applies
    return found


def children(cells: Integers) -> Integers:
    """(8n, 3) the cells of half the size in cells (n, 3)."""
    halves: Integers = (2 * cells[:, None] + OFFSETS).reshape(-1, 3)
    return halves


def code(cells: Integers) -> Integers:
    """(n,) one number for the position of each cell or point (n, 3), which may be −1 … 2²⁰."""
    x, y, z = (cells + 1).T
    one: Integers = ((x << 21) + y << 21) + z
    return one


def unbalanced(leaves: Leaves) -> Integers:
    """Leaves (numbers) that share a face or an edge with one of less than half their size."""
    directions = [d for d in product((-1, 0, 1), repeat=3) if 0 < sum(map(abs, d)) < 3]
    wrong = [np.zeros(0, np.int64)]
    near = np.zeros((0, 3), dtype=np.int64)
    for level in range(int(leaves.level.max(initial=0)), 1, -1):
        own = leaves.index[leaves.level == level]
        around = np.concatenate([own + d for d in directions]) >> 1
        near = np.concatenate((near, around)) if len(own) else near
        near = near[np.unique(code(near), return_index=True)[1]] >> 1
        coarse = np.nonzero(leaves.level == level - 2)[0]
        wrong.append(coarse[np.isin(code(leaves.index[coarse]), code(near))])
    return np.unique(np.concatenate(wrong))
