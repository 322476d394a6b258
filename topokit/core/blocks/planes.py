"""The two compiled loops over voxels: label a plane in both phases, and join two planes that lie face to face.

A row of voxels is a sequence of runs of one phase: a run has its label and its stop (last + 1) written where it starts,
and nothing elsewhere, so that labels cost time by runs and not by voxels. A label is a number from 1 on in the
6-connected phase and its negative in the 26-connected one, so the sign is the phase. Numbers are those of a union-find
forest; what is known of each is a row of a table (see `part.NODE_COLUMNS`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.compiled import compiled

Bytes = NDArray[np.uint8]
Words = NDArray[np.uint64]
Labels = NDArray[np.int32]


@compiled
def root_of(parents: Labels | Integers, node: int) -> int:
    """The root of a node; the way there is shortened."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@compiled
def unite(parents: Labels, one: int, other: int) -> int:
    """The root of both nodes, after their trees are joined."""
    one, other = root_of(parents, one), root_of(parents, other)
    root = min(one, other)
    parents[one] = root
    parents[other] = root
    return root


@compiled
def _end_of_run(row: Booleans, words: Words, start: int, n: int) -> int:
    """Where the run of a row of n voxels that starts there ends; eight voxels at a time where they are alike."""
    phase, stop = row[start], start + 1
    alike = np.uint64(0x0101010101010101 if phase else 0)
    while stop < n and row[stop] == phase:
        stop += 1
        if stop % 8 == 0:
            while stop + 8 <= n and words[stop // 8] == alike:
                stop += 8
    return stop


@compiled
def label_plane(
    is_six: Booleans,
    n: int,
    place: Integers,
    shape: Integers,
    parents: Labels,
    nodes: Integers,
    phases: Booleans,
    n_nodes: int,
    labels: Labels,
    stops: Labels,
) -> int:
    """Label the regions of a plane across the first axis of a volume; each becomes a node of the forest.

    Args:
        is_six: (Y, a multiple of 8), whether a voxel is in the 6-connected phase, which joins through edges of the
            plane; the other phase also joins through corners.
        n: length of its rows; what comes after is not looked at.
        place: (3,) position of the plane's first voxel in the volume.
        shape: (3,) of the volume.
        parents: of the forest, with room for another node per voxel.
        nodes: their rows, with as much room.
        phases: whether they are in the 6-connected phase, likewise.
        n_nodes: nodes in the forest so far.
        labels: (Y, Z), where the labels of the runs are written.
        stops: (Y, Z), where their stops are written.

    Returns:
        The number of nodes afterward.
    """
    words = is_six.view(np.uint64)
    for y in range(len(is_six)):
        start, above = 0, 0
        while start < n:
            phase = is_six[y, start]
            stop = _end_of_run(is_six[y], words[y], start, n)
            node, reach = -1, 0 if phase else 1
            if y > 0:
                while stops[y - 1, above] <= start - reach:
                    above = stops[y - 1, above]
                node = _united_above(labels[y - 1], stops[y - 1], above, min(stop + reach, n), phase, parents)
            if node < 0:
                node = n_nodes
                n_nodes += 1
                parents[node], phases[node] = node, phase
                first = ((place[0] * shape[1]) + place[1] + y) * shape[2] + place[2] + start
                _write_node(nodes[node], first, place[0], place[1] + y, place[2] + start)
            nodes[node, 0] += stop - start
            nodes[node, 4] = min(nodes[node, 4], place[2] + start)
            nodes[node, 6] = place[1] + y + 1
            nodes[node, 7] = max(nodes[node, 7], place[2] + stop)
            labels[y, start], stops[y, start] = node + 1 if phase else -(node + 1), stop
            start = stop
    return n_nodes


@compiled
def _united_above(labels: Labels, stops: Labels, start: int, stop: int, phase: bool, parents: Labels) -> int:
    """The root of the runs of a phase in the row above that lie before a stop, after they are united; −1 for none."""
    node, z = -1, start
    while z < stop:
        if (labels[z] > 0) == phase:
            found = root_of(parents, abs(labels[z]) - 1)
            node = found if node < 0 else unite(parents, node, found)
        z = stops[z]
    return node


@compiled
def _write_node(row: Integers, first: int, x: int, y: int, z: int) -> None:
    """Write the row of a region whose first voxel is at (x, y, z), but which has no size yet."""
    row[0], row[1] = 0, first
    row[2], row[3], row[4] = x, y, z
    row[5], row[6], row[7] = x + 1, y + 1, z + 1


@compiled
def join_planes(
    lower: Labels,
    lower_stops: Labels,
    upper: Labels,
    upper_stops: Labels,
    parents: Labels,
    pieces: Bytes,
    weights: Integers,
    dual: Integers,
    sums: Integers,
    full: Integers,
) -> tuple[int, int]:
    """Unite the regions of two labeled planes that lie face to face, and add up the surface between them.

    Each cube of 2 × 2 × 2 voxels of the two planes counts once (see `cubes`). Cubes between the same four runs are
    equal, so they are counted at once.

    Args:
        lower: (n, m) labels of the runs of one plane.
        lower_stops: their stops.
        upper: those of the other plane.
        upper_stops: their stops.
        parents: of the forest.
        pieces: table of `cubes.CubeTables`.
        weights: likewise.
        dual: likewise.
        sums: (a power of two, 6), sums of weights by pairs of nodes: a node of the 6-connected phase or −1, one of the
            other phase, and four weights. A pair has one place; whoever comes later takes it.
        full: (8 n m, 6), where the sums go that lose their place.

    Returns:
        How many rows of `full` were written; and the sum of `dual`.
    """
    n_full, dual_sum, n = 0, 0, lower.shape[1]
    cube = np.zeros(8, np.int32)
    for y in range(lower.shape[0] - 1):
        z, after = 0, 0
        stop_0, stop_1, stop_2, stop_3 = 0, 0, 0, 0
        while z < n:
            before = after
            for k in range(4):
                cube[k] = cube[4 + k]
            if stop_0 == z:
                cube[4], stop_0 = lower[y, z], lower_stops[y, z]
            if stop_1 == z:
                cube[5], stop_1 = lower[y + 1, z], lower_stops[y + 1, z]
            if stop_2 == z:
                cube[6], stop_2 = upper[y, z], upper_stops[y, z]
            if stop_3 == z:
                cube[7], stop_3 = upper[y + 1, z], upper_stops[y + 1, z]
            after = (cube[4] > 0) | (cube[5] > 0) << 1 | (cube[6] > 0) << 2 | (cube[7] > 0) << 3
            if z > 0:  # the cube across the start of a run
                code = before | after << 4
                n_full = _add_cubes(cube, code, 1, parents, pieces, weights, sums, full, n_full)
                dual_sum += dual[code]
            stop = min(min(stop_0, stop_1), min(stop_2, stop_3))
            n_inside = stop - z - 1
            code = after | after << 4
            if n_inside > 0 and (z == 0 or (code != 0 and code != 255)):
                for k in range(4):
                    cube[k] = cube[4 + k]
                n_full = _add_cubes(cube, code, n_inside, parents, pieces, weights, sums, full, n_full)
                dual_sum += dual[code] * n_inside
            z = stop
    return n_full, dual_sum


@compiled
def write_runs(dense: Labels, stops: Labels) -> None:
    """Write the stops of the runs of dense labels (n, m) where they start, into (n, m)."""
    for y in range(dense.shape[0]):
        start = 0
        for z in range(1, dense.shape[1] + 1):
            if z == dense.shape[1] or dense[y, z] != dense[y, start]:
                stops[y, start] = z
                start = z


@compiled
def write_dense(labels: Labels, stops: Labels, dense: Labels) -> None:
    """Write the labels of runs (n, m) at all their voxels, into (n, m)."""
    for y in range(labels.shape[0]):
        z = 0
        while z < labels.shape[1]:
            dense[y, z : stops[y, z]] = labels[y, z]
            z = stops[y, z]


@compiled
def gather_nodes(nodes: Integers, numbers: Labels, gathered: Integers) -> None:
    """Add the rows of nodes to those of the nodes that they belong to.

    Args:
        nodes: (N, 8) rows.
        numbers: (N,) where each belongs.
        gathered: (M, 8), where the sums are written; its content does not matter.
    """
    gathered[:, 0] = 0
    gathered[:, 1:5] = np.iinfo(np.int64).max
    gathered[:, 5:] = -1
    for node in range(len(nodes)):
        row = gathered[numbers[node]]
        row[0] += nodes[node, 0]
        for k in range(1, 5):
            row[k] = min(row[k], nodes[node, k])
        for k in range(5, 8):
            row[k] = max(row[k], nodes[node, k])


@compiled
def number_roots(parents: Labels, numbers: Labels) -> int:
    """Number the trees of a forest 0, 1, … by their roots, which are their first nodes.

    Args:
        parents: (N,) of the forest.
        numbers: (N,), where the number of each node's tree is written.

    Returns:
        How many trees there are.
    """
    n_trees = 0
    for node in range(len(parents)):
        if parents[node] == node:
            numbers[node] = n_trees
            n_trees += 1
        else:
            numbers[node] = numbers[root_of(parents, node)]
    return n_trees


@compiled
def hang_leaves(first: Integers, second: Integers, is_root: Booleans, parent: Integers) -> None:
    """Write the parent of every node of some trees but their roots, leaf by leaf; a node on a cycle gets none.

    Args:
        first: (E,) one end of each edge.
        second: (E,) the other one.
        is_root: (N,), of one node of each tree.
        parent: (N,), where they are written.
    """
    n_edges, others = np.zeros(len(parent), np.int64), np.zeros(len(parent), np.int64)  # neighbors, as their xor
    for edge in range(len(first)):
        a, b = first[edge], second[edge]
        n_edges[a] += 1
        n_edges[b] += 1
        others[a] ^= b
        others[b] ^= a
    for node in range(len(parent)):
        while not is_root[node] and n_edges[node] == 1:
            above = others[node]
            parent[node] = above
            n_edges[node] = 0
            n_edges[above] -= 1
            others[above] ^= node
            node = above


@compiled
def _add_cubes(
    cube: Labels,
    code: int,
    n_cubes: int,
    parents: Labels,
    pieces: Bytes,
    weights: Integers,
    sums: Integers,
    full: Integers,
    n_full: int,
) -> int:
    """Unite what is joined in a cube with these labels at its corners, and add the surface in so many equal cubes."""
    around = _united(cube, 255 & ~code, parents)
    for k in range(4):
        piece = pieces[code, k]
        if piece == 0:
            break
        node = _united(cube, piece, parents)
        if code == 255:
            break
        n_full = add_to_pair(node, around, n_cubes, weights, piece, sums, full, n_full)
    return n_full


@compiled
def add_to_pair(
    one: int, other: int, n_cubes: int, weights: Integers, code: int, sums: Integers, full: Integers, n_full: int
) -> int:
    """Add the weights of a code in so many cubes to the sums of a pair; see `join_planes`.

    Returns:
        How many rows of `full` are written.
    """
    place = (one * 31 + other) & (len(sums) - 1)
    if sums[place, 0] != one or sums[place, 1] != other:
        if sums[place, 0] >= 0:
            for column in range(6):  # rows one number at a time: slices take Numba seconds to compile
                full[n_full, column] = sums[place, column]
            n_full += 1
        sums[place, 0], sums[place, 1] = one, other
        for column in range(2, 6):
            sums[place, column] = 0
    for column in range(4):
        sums[place, 2 + column] += n_cubes * weights[code, column]
    return n_full


@compiled
def _united(cube: Labels, corners: int, parents: Labels) -> int:
    """The root of the regions at those corners of a cube that are in a code, after they are united; −1 for none."""
    last, root = 0, -1
    for k in range(8):
        corner = (k & 1) | (k & 2) << 1 | (k & 4) >> 1  # first the lower plane, where neighbors often are one region
        if corners >> corner & 1 and cube[corner] != last:
            last = cube[corner]
            found = root_of(parents, abs(last) - 1)
            root = found if root < 0 else unite(parents, root, found)
    return root
