"""Two volumes counted block by block: the numbers of the whole, for any blocks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from topokit.core.blocks.division import Division
from topokit.core.comparison.in_blocks import count_pair, counted_pair, join_pairs
from topokit.core.comparison.pair import SolidPair


def random_pair(shape: tuple[int, int, int], seed: int, level: float):
    generator = np.random.default_rng(seed)
    one, noise = (gaussian_filter(generator.standard_normal(shape), 0.7) for _ in range(2))
    return one > level * one.std(), one / one.std() + 0.7 * noise / noise.std() > level


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("level", [-1.2, 0.0, 1.2])
@pytest.mark.parametrize("most", [60, 500, 10**6])
def test_blocks_give_the_numbers_of_the_whole(connectivity: int, level: float, most: int) -> None:
    first, second = random_pair((17, 12, 15), 4, level)

    def count(box):
        own = tuple(slice(*side) for side in box)
        return count_pair(first[own], second[own], box, first.shape, connectivity)

    whole = Division.even(first.shape, most).reduce(count, join_pairs).without_faces()
    found, expected = counted_pair(whole, first.shape, connectivity), SolidPair(first, second, connectivity).numbers
    assert (found.first, found.second) == (expected.first, expected.second)
    assert found.matched == expected.matched[::2]
    assert max(found.matched) > 0


def test_empty_solids() -> None:
    empty, full = np.zeros((3, 4, 5), bool), np.ones((3, 4, 5), bool)
    box = ((0, 3), (0, 4), (0, 5))
    for pair, parts in (((empty, full), 0), ((empty, empty), 0), ((full, full), 1)):
        found = counted_pair(count_pair(*pair, box, (3, 4, 5), 26), (3, 4, 5), 26)
        assert found.matched == (parts, 0)
