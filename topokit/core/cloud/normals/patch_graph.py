"""Relative signs of patches, by merging the two whose common border tells most, over and over.

Along a crease many edges of the neighbor graph join two patches, and each votes on whether their signs agree. The votes
of a whole border are far more reliable than the one edge that a spanning tree takes. After every merge the votes of the
united patch are summed anew, so that short and doubtful borders are read last.

References:
    N. Schertler, B. Savchynskyy, S. Gumhold, "Towards globally optimal normal orientations for large point clouds",
    Computer Graphics Forum 36(1), 2017, doi:10.1111/cgf.12795, for signs of patches as a graph problem.
    M. Keuper et al., "Efficient decomposition of image and mesh graphs by lifted multicuts", ICCV 2015, for the greedy
    contraction of edges; here the united patches keep relative signs.
"""

from __future__ import annotations

import heapq

import numpy as np
from scipy.sparse import coo_array

from topokit.core.arrays import Floats, Integers


def relative_signs(count: int, first: Integers, second: Integers, votes: Floats) -> Floats:
    """Signs (count,) of patches, +1 or −1: relative to each other within every connected part of their graph.

    Args:
        count: number of patches.
        first: (E,), one patch of every edge; pairs of patches may occur many times.
        second: (E,), the other one.
        votes: (E,), positive where the signs agree.
    """
    graph = _Graph(count, first, second, votes)
    while graph.queue:
        graph.merge_next()
    return graph.signs


class _Graph:
    """Patches, merged step by step; each keeps the summed votes with its neighbors."""

    def __init__(self, count: int, first: Integers, second: Integers, votes: Floats) -> None:
        low, high = np.minimum(first, second), np.maximum(first, second)
        summed = coo_array((votes, (low, high)), shape=(count, count)).tocsr().tocoo()
        self.votes: list[dict[int, float]] = [{} for _ in range(count)]
        self.queue: list[tuple[float, int, int]] = []
        for one, other, vote in zip(summed.row.tolist(), summed.col.tolist(), summed.data.tolist(), strict=True):
            self._set(one, other, vote)
        self.members = [[patch] for patch in range(count)]
        self.signs = np.ones(count)

    def _set(self, one: int, other: int, vote: float) -> None:
        self.votes[one][other] = self.votes[other][one] = vote
        heapq.heappush(self.queue, (-abs(vote), min(one, other), max(one, other)))

    def merge_next(self) -> None:
        """Merge the patches whose votes are clearest; nothing if these have changed since."""
        strength, one, other = heapq.heappop(self.queue)
        vote = self.votes[one].get(other)
        if vote is None or abs(vote) != -strength:
            return
        if len(self.members[one]) < len(self.members[other]):
            one, other = other, one
        sign = 1.0 if vote >= 0 else -1.0
        self.signs[self.members[other]] *= sign
        self.members[one] += self.members[other]
        del self.votes[one][other], self.votes[other][one]
        for neighbor, theirs in self.votes[other].items():
            del self.votes[neighbor][other]
            self._set(one, neighbor, self.votes[one].get(neighbor, 0.0) + sign * theirs)
        self.votes[other] = {}
