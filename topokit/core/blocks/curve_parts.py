"""The curve of a volume over its levels, block by block.

Numbers of cells are additive: χ of two boxes is the sum of theirs and of what lies between their faces, which is χ of
the two layers together minus that of each. Of the regions of a box only those that reach a face to another box may
still change. They are kept as a forest on the voxels of these faces, each link with the level at which the box joins
its ends, a maximum spanning forest. So is what two boxes leave, by Kruskal's algorithm.

Reference:
    D. Morozov, G. Weber, "Distributed merge trees", PPoPP 2013, doi:10.1145/2442516.2442526.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.core.blocks.curve import Tally, tally_changes, tally_euler
from topokit.core.blocks.division import Box, Triple
from topokit.core.blocks.links import join_regions

Numbers = NDArray[np.int32]
Ends = tuple[Numbers | None, Numbers | None]


@dataclass(frozen=True, eq=False)
class CurvePart:
    """What is known of a box of a volume at all levels.

    Attributes:
        tally: the changes of χ, pieces and cavities that depend on nothing beyond the box.
        ranks: (N,) of the voxels at open faces, which are nodes 0 … N − 1. Node N is the outside of the volume.
        faces: for each axis the nodes of the first and of the last layer; None where the volume ends.
        links: (L, 3) of the solid and of the background: two nodes that are joined in the box, and the rank at which.
    """

    tally: Tally
    ranks: NDArray[Any]
    faces: tuple[Ends, ...]
    links: tuple[Numbers, Numbers]


def count_curve_part(ranks: NDArray[Any], box: Box, shape: Triple, connectivity: int, n_ranks: int) -> CurvePart:
    """The part of one block.

    Args:
        ranks: (X, Y, Z) uint8 or int32, from 0 on.
        box: of the block in the volume, first and last + 1 voxel along each axis.
        shape: of the volume.
        connectivity: 6 or 26, that of the solid.
        n_ranks: how many ranks there are in the volume.
    """
    tally, ends = Tally(0, n_ranks - 1), [(a > 0, b < n) for (a, b), n in zip(box, shape, strict=True)]
    links = tally_changes(np.ascontiguousarray(ranks), connectivity == 6, _as_bits(ends), tally)
    numbers = np.full(ranks.size + 1, -1, np.int32)
    grid = numbers[:-1].reshape(ranks.shape)
    for axis, side in product(range(3), range(2)):
        if ends[axis][side]:
            np.moveaxis(grid, axis, 0)[-side] = 0
    nodes = np.flatnonzero(numbers == 0)
    numbers[nodes], numbers[-1] = np.arange(len(nodes)), len(nodes)
    values = ranks.reshape(-1)
    faces = tuple(
        tuple(np.moveaxis(grid, axis, 0)[-side].copy() if ends[axis][side] else None for side in range(2))
        for axis in range(3)
    )
    solid, background = (np.column_stack((numbers[one[:, :2]], values[one[:, 2]])).astype(np.int32) for one in links)
    return CurvePart(tally, values[nodes], faces, (solid, background))  # type: ignore[arg-type]


def join_curve_parts(connectivity: int, one: CurvePart, other: CurvePart, axis: int) -> CurvePart:
    """The part of two boxes that lie side by side.

    Args:
        connectivity: 6 or 26, that of the solid.
        one: the box that comes first along the axis.
        other: the next one, of the same size and place along the other axes.
        axis: 0, 1 or 2.
    """
    ranks, tally = np.concatenate((one.ranks, other.ranks)), one.tally + other.tally
    shift = len(one.ranks)
    below, above = one.faces[axis][1], other.faces[axis][0]
    if below is None or above is None:
        raise AssertionError("two boxes are to be joined where the volume ends")
    above = above + np.int32(shift)
    layers = np.stack((ranks[below], ranks[above]))
    _tally_between(layers, one.faces[:axis] + one.faces[axis + 1 :], connectivity == 6, tally)

    faces = tuple(_joined_faces(one, other, axis, number, shift) for number in range(3))
    is_gone = np.ones(len(ranks) + 1, bool)
    for nodes in (nodes for ends in faces for nodes in ends if nodes is not None):
        is_gone[nodes] = False
    is_gone[-1] = False
    n_gone = int(is_gone.sum())
    numbers = np.where(is_gone, np.cumsum(is_gone), n_gone + np.cumsum(~is_gone)).astype(np.int32) - np.int32(1)
    own = (numbers[:shift], numbers[-1:]), (numbers[shift:],)
    ended, links = ranks[is_gone[:-1]], []
    for phase in range(2):
        known = [_renumbered(part.links[phase], np.concatenate(n)) for part, n in zip((one, other), own, strict=True)]
        is_six = (connectivity == 6) == (phase == 0)
        between = _links_between(layers, numbers[below], numbers[above], is_six, phase == 1)
        merged, found = _joined(np.concatenate((*known, between)), len(numbers), n_gone, phase == 1)
        sign = 1 - 2 * phase
        tally.add(1 + phase, ended, np.full(len(ended), sign))
        tally.add(1 + phase, merged, np.full(len(merged), -sign))
        links.append(found)
    kept = tuple(tuple(None if nodes is None else numbers[nodes] - n_gone for nodes in ends) for ends in faces)
    return CurvePart(tally, ranks[~is_gone[:-1]], kept, (links[0], links[1]))  # type: ignore[arg-type]


def _as_bits(ends: list[tuple[bool, bool]]) -> int:
    return sum(1 << 2 * axis + side for axis in range(3) for side in range(2) if ends[axis][side])


def _joined_faces(one: CurvePart, other: CurvePart, axis: int, number: int, shift: int) -> Ends:
    """The nodes of both faces along an axis, of two boxes side by side."""
    theirs = [None if nodes is None else nodes + np.int32(shift) for nodes in other.faces[number]]
    if number == axis:
        return one.faces[number][0], theirs[1]
    along = axis - (axis > number)  # the axis of joining among those of the face
    first, last = (
        None if mine is None or nodes is None else np.concatenate((mine, nodes), along)
        for mine, nodes in zip(one.faces[number], theirs, strict=True)
    )
    return first, last


def _tally_between(layers: NDArray[Any], others: tuple[Ends, ...], solid_is_six: bool, tally: Tally) -> None:
    """Add the changes of χ by cells between two layers (2, Y, Z), whose other ends are open or not."""
    open_faces = _as_bits([(True, True), *((low is not None, high is not None) for low, high in others)])
    for values, sign in ((layers, 1), (layers[:1], -1), (layers[1:], -1)):
        tally_euler(np.ascontiguousarray(values), solid_is_six, open_faces, tally, sign)


def _links_between(layers: NDArray[Any], below: Numbers, above: Numbers, is_six: bool, of_background: bool) -> Numbers:
    """Links (L, 3) between the nodes of two layers, as many as it takes beside those within each layer.

    A link is left out if there is a way around it over voxels that are there before: over the link beside it, or, if
    it is diagonal, over the straight one at either end.
    """
    time = layers.astype(np.int32) if of_background else -layers.astype(np.int32)
    straight = time.max(axis=0)
    needed = np.ones(straight.shape, bool)
    needed[1:] &= straight[:-1] > straight[1:]
    needed[:, 1:] &= straight[:, :-1] > straight[:, 1:]
    found = [np.column_stack((below[needed], above[needed], straight[needed]))]
    for dy, dz in () if is_six else product((-1, 0, 1), repeat=2):
        if dy or dz:
            here, there = _shifted(dy, dz), _shifted(-dy, -dz)
            diagonal = np.maximum(time[0][here], time[1][there])
            needed = (time[1][here] > diagonal) & (time[0][there] > diagonal)
            found.append(np.column_stack((below[here][needed], above[there][needed], diagonal[needed])))
    links = np.concatenate(found)
    links[:, 2] = np.abs(links[:, 2])
    return links


def _shifted(dy: int, dz: int) -> tuple[slice, slice]:
    """The voxels of a layer that have a neighbor at (dy, dz)."""
    y, z = (slice(max(0, -step), -1 if step > 0 else None) for step in (dy, dz))
    return y, z


def _renumbered(links: Numbers, numbers: Numbers) -> Numbers:
    return np.column_stack((numbers[links[:, :2]], links[:, 2]))


def _joined(links: Numbers, n_nodes: int, n_gone: int, of_background: bool) -> tuple[NDArray[Any], Numbers]:
    """The ranks at which regions end because they join others, and the links (L, 3) between nodes that are left."""
    time = links[:, 2] if of_background else links[:, 2].max(initial=0) - links[:, 2]
    order = np.argsort(time.astype(np.uint16), kind="stable")
    first, second, ranks = np.ascontiguousarray(links[order].T)
    results = np.zeros(len(links), np.int8)
    join_regions(first, second, n_gone, np.arange(n_nodes, dtype=np.int32), results)
    left = results == 2
    kept = np.column_stack((first[left] - n_gone, second[left] - n_gone, ranks[left]))
    return ranks[results == 1], kept
