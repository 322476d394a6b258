"""Matched features of two solids: the definition, symmetry, and cases that are known."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from chain_complexes import matched_by_definition
from scipy.ndimage import gaussian_filter

from topokit.core.comparison.pair import MatchedNumbers, SolidPair
from topokit.core.grid.betti import betti_numbers


def random_pair(shape: tuple[int, int, int], seed: int, sigma: float, level: float = 0.3):
    generator = np.random.default_rng(seed)
    one, noise = (gaussian_filter(generator.standard_normal(shape), sigma) for _ in range(2))
    return one > level * one.std(), one / one.std() + 0.7 * noise / noise.std() > level


def numbers(first, second, connectivity: int) -> MatchedNumbers:
    return SolidPair(first, second, connectivity).numbers


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("sigma", [0.0, 0.4, 0.8])
def test_equals_the_definition(connectivity: int, sigma: float) -> None:
    for seed in range(6):
        first, second = random_pair((6, 5, 7), seed, sigma, level=0.5 if connectivity == 6 else 1.0)
        found = numbers(first, second, connectivity)
        expected = matched_by_definition(first, second, connectivity)
        assert list(zip(found.first, found.second, found.matched, strict=True)) == expected


@pytest.mark.parametrize("connectivity", [6, 26])
def test_all_symmetries_of_the_grid_agree(connectivity: int) -> None:
    first, second = random_pair((20, 18, 16), 3, 1.2)
    expected = numbers(first, second, connectivity)
    assert 0 < expected.matched[1] < min(expected.first[1], expected.second[1])
    for axes, steps in product(permutations(range(3)), product((1, -1), repeat=3)):
        moved = [solid.transpose(axes)[tuple(slice(None, None, step) for step in steps)] for solid in (first, second)]
        assert numbers(*moved, connectivity) == expected


@pytest.mark.parametrize("connectivity", [6, 26])
def test_betti_numbers_are_those_of_the_grid_and_sides_can_be_exchanged(connectivity: int) -> None:
    first, second = random_pair((40, 40, 40), 5, 1.5)
    found = numbers(first, second, connectivity)
    assert [found.first, found.second] == [
        tuple(betti_numbers(solid, connectivity=connectivity).tolist()) for solid in (first, second)
    ]
    assert numbers(second, first, connectivity) == MatchedNumbers(found.second, found.first, found.matched)
    assert numbers(first, first, connectivity) == MatchedNumbers(found.first, found.first, found.first)


def test_equal_betti_numbers_need_not_match() -> None:
    """A ring, and one that is apart from it, touches it side by side, or lies on it."""
    first = np.zeros((12, 7, 5), bool)
    first[1:6, 1:6, 1] = True
    first[2:5, 2:5, 1] = False
    for shift, matched in (((6, 0, 0), (0, 0, 0)), ((5, 0, 0), (1, 0, 0)), ((0, 0, 1), (1, 1, 0))):
        second = np.roll(first, shift, (0, 1, 2))
        assert numbers(first, second, 26) == MatchedNumbers((1, 1, 0), (1, 1, 0), matched)


def test_empty_solids() -> None:
    empty, full = np.zeros((3, 4, 5), bool), np.ones((3, 4, 5), bool)
    assert numbers(empty, empty, 26) == MatchedNumbers((0, 0, 0), (0, 0, 0), (0, 0, 0))
    assert numbers(empty, full, 6) == MatchedNumbers((0, 0, 0), (1, 0, 0), (0, 0, 0))


@pytest.mark.parametrize("connectivity", [6, 26])
def test_cavities_that_are_linked_in_a_chain_are_one(connectivity: int) -> None:
    """Both solids have two cavities: one wall is missing in each, another one in each, so that only one is common."""
    walls = np.ones((5, 5, 15), bool)
    for cavity in range(3):
        walls[2, 2, 2 + 4 * cavity : 5 + 4 * cavity] = False
    first, second = walls.copy(), walls.copy()
    first[2, 2, 5], second[2, 2, 9] = False, False
    assert numbers(first, second, connectivity) == MatchedNumbers((1, 0, 2), (1, 0, 2), (1, 0, 1))
