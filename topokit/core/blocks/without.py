"""The connected components of a graph without one group of its nodes, for each of many groups.

The groups are halved again and again. Before either half is looked at, edges that touch the other half alone are added
to a union-find forest, and afterward they are taken out again; so all groups together cost as much as the edges times
the logarithm of the number of groups.
"""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Integers
from topokit.core.blocks.compiled import compiled


def components_without(
    owners: Integers, ends: Integers, starts: Integers, nodes: Integers
) -> tuple[Integers, Integers, Integers]:
    """The components next to each group of the nodes that are not in it.

    Args:
        owners: (N,) the group of each node, from 0 on; −1 for those that are never taken out.
        ends: (E, 2) edges, each in both directions, in ascending order of the group of their first node.
        starts: (K + 1,) where the edges out of each group start, and their number; before come those out of no group.
        nodes: (N, 8), the row of `part.NODE_COLUMNS` of each node; it is used up.

    Returns:
        For each edge out of a group the component that it leads to, −1 if it stays in the group (E,); the group that
        each component lies around, ascending (C,); and the row of each component (C, 8).
    """
    component, seen = np.full(len(ends), -1), np.full(len(owners), -1)
    groups, rows = np.empty(len(ends), np.int64), np.empty((len(ends), nodes.shape[1]), np.int64)
    trees, undone = np.stack((np.arange(len(owners)), np.zeros_like(owners))), np.empty(len(owners), np.int64)
    waiting = np.zeros((128, 5), np.int64)  # two for each halving: groups, those that are there again, unions to keep
    n_found = _halve(owners, ends, starts, nodes, trees, undone, nodes.copy(), waiting, component, seen, groups, rows)
    return component, groups[:n_found].copy(), rows[:n_found].copy()


@compiled
def _halve(
    owners: Integers,
    ends: Integers,
    starts: Integers,
    nodes: Integers,
    trees: Integers,
    undone: Integers,
    saved: Integers,
    waiting: Integers,
    component: Integers,
    seen: Integers,
    groups: Integers,
    rows: Integers,
) -> int:
    """Fill in what `components_without` returns; the number of components."""
    n_done, n_found, n_waiting = 0, 0, 1
    for edge in range(starts[0]):
        if owners[ends[edge, 1]] < 0:
            n_done = _unite(ends[edge, 0], ends[edge, 1], trees, nodes, undone, saved, n_done)
    waiting[0, 1], waiting[0, 4] = len(starts) - 1, n_done
    while n_waiting:
        n_waiting -= 1
        low, high, level = waiting[n_waiting, 0], waiting[n_waiting, 1], waiting[n_waiting, 4]
        while n_done > level:
            n_done -= 1
            _undo(undone[n_done], trees, nodes, saved, n_done)
        for edge in range(starts[waiting[n_waiting, 2]], starts[waiting[n_waiting, 3]]):
            if owners[ends[edge, 1]] < low or owners[ends[edge, 1]] >= high:
                n_done = _unite(ends[edge, 0], ends[edge, 1], trees, nodes, undone, saved, n_done)
        if high - low > 1:
            middle = (low + high) // 2
            waiting[n_waiting, 0], waiting[n_waiting, 1] = middle, high
            waiting[n_waiting, 2], waiting[n_waiting, 3], waiting[n_waiting, 4] = low, middle, n_done
            n_waiting += 1
            waiting[n_waiting, 0], waiting[n_waiting, 1] = low, middle
            waiting[n_waiting, 2], waiting[n_waiting, 3], waiting[n_waiting, 4] = middle, high, n_done
            n_waiting += 1
            continue
        for edge in range(starts[low], starts[high]):
            if owners[ends[edge, 1]] == low:
                continue
            root = _root(ends[edge, 1], trees)
            if seen[root] < 0 or groups[seen[root]] != low:
                seen[root], groups[n_found] = n_found, low
                for column in range(nodes.shape[1]):
                    rows[n_found, column] = nodes[root, column]
                n_found += 1
            component[edge] = seen[root]
    return n_found


@compiled
def _root(node: int, trees: Integers) -> int:
    while trees[0, node] != node:
        node = trees[0, node]
    return node


@compiled
def _unite(
    one: int, other: int, trees: Integers, nodes: Integers, undone: Integers, saved: Integers, n_done: int
) -> int:
    """Unite the trees of two nodes, given as parents and heights, and note how it was before."""
    one, other = _root(one, trees), _root(other, trees)
    if one == other:
        return n_done
    if trees[1, one] < trees[1, other]:
        one, other = other, one
    is_higher = trees[1, one] == trees[1, other]
    undone[n_done] = -1 - other if is_higher else other
    trees[0, other] = one
    trees[1, one] += is_higher
    for column in range(nodes.shape[1]):
        mine, added = nodes[one, column], nodes[other, column]
        saved[n_done, column] = mine
        nodes[one, column] = mine + added if column == 0 else min(mine, added) if column < 5 else max(mine, added)
    return n_done + 1


@compiled
def _undo(note: int, trees: Integers, nodes: Integers, saved: Integers, number: int) -> None:
    """Take back the last union."""
    child = note if note >= 0 else -1 - note
    root = trees[0, child]
    trees[1, root] -= note < 0
    trees[0, child] = child
    for column in range(nodes.shape[1]):
        nodes[root, column] = saved[number, column]
