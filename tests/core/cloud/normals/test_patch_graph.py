"""Relative signs of patches: the votes of whole borders decide, in every connected part."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.normals.patch_graph import relative_signs

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def agreement(signs: Floats, first: Integers, second: Integers, votes: Floats) -> float:
    return float((votes * signs[first] * signs[second]).sum())


def test_signs_are_recovered_though_a_fifth_of_the_votes_is_wrong() -> None:
    draws = np.random.default_rng(0)
    count, n_votes = 300, 40_000
    known = draws.choice([-1.0, 1.0], count)
    start = draws.integers(count - 3, size=n_votes)
    first, second = start, start + draws.integers(1, 4, n_votes)  # a band: no patch has more than six neighbors
    is_wrong = draws.random(n_votes) < 0.2
    votes = known[first] * known[second] * draws.random(n_votes) * np.where(is_wrong, -1, 1)
    found = relative_signs(count, first, second, votes)
    assert (found * found[0] == known * known[0]).all()


def test_one_strong_edge_does_not_decide_against_a_long_border() -> None:
    first, second = np.zeros(6, dtype=np.int64), np.ones(6, dtype=np.int64)
    signs = relative_signs(2, first, second, np.array([1.0, -0.3, -0.3, -0.3, -0.3, -0.3]))
    assert signs[0] != signs[1]


def test_doubtful_borders_are_read_last() -> None:
    first, second = np.array([0, 1, 0]), np.array([1, 2, 2])
    signs = relative_signs(3, first, second, np.array([5.0, 4.0, -1.0]))  # of a cycle that no signs satisfy
    assert (signs == signs[0]).all()


def test_small_graphs_reach_nearly_the_best_agreement() -> None:
    draws = np.random.default_rng(1)
    ratios = []
    for _ in range(50):
        first, second = draws.integers(7, size=(2, 20))
        first, second = first[first != second], second[first != second]
        votes = draws.normal(size=len(first))
        every = (np.array(signs) for signs in itertools.product((-1.0, 1.0), repeat=7))
        best = max(agreement(signs, first, second, votes) for signs in every)
        ratios.append(agreement(relative_signs(7, first, second, votes), first, second, votes) / best)
    assert min(ratios) > 0.6
    assert np.mean(ratios) > 0.95


def test_parts_without_votes_keep_their_signs() -> None:
    nothing = np.empty(0, dtype=np.int64)
    assert (relative_signs(3, nothing, nothing, np.empty(0)) == 1).all()
    signs = relative_signs(4, np.array([0]), np.array([1]), np.array([-1.0]))
    assert signs[0] != signs[1]
    assert (signs[2:] == 1).all()


def test_the_order_of_the_votes_does_not_matter() -> None:
    draws = np.random.default_rng(2)
    first, second = draws.integers(40, size=400), draws.integers(40, 80, size=400)
    votes, order = draws.normal(size=400), draws.permutation(400)
    found = relative_signs(80, first, second, votes)
    again = relative_signs(80, second[order], first[order], votes[order])
    assert (found == again).all()
