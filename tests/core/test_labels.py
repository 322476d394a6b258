"""Connected components of graphs."""

from __future__ import annotations

import numpy as np
import pytest

from topokit.core.labels import compact_labels, connected_labels


def test_labels_are_numbered_by_first_appearance() -> None:
    first, second = np.array([5, 2, 4, 4, 0]), np.array([1, 4, 2, 4, 3])
    assert connected_labels(7, first, second).tolist() == [0, 1, 2, 0, 2, 1, 3]


@pytest.mark.parametrize("seed", range(5))
def test_they_are_those_of_repeated_relabeling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, 60, (40, 2))
    expected = np.arange(60)
    for _ in range(60):
        for a, b in ends:
            expected[[a, b]] = expected[[a, b]].min()
    found = connected_labels(60, ends[:, 0], ends[:, 1])
    assert (found[:, None] == found[None]).tolist() == (expected[:, None] == expected[None]).tolist()
    assert (np.diff(np.unique(found, return_index=True)[1]) > 0).all()


def test_no_edges_and_no_nodes() -> None:
    none = np.zeros(0, dtype=np.int64)
    assert connected_labels(3, none, none).tolist() == [0, 1, 2]
    assert compact_labels(np.array([7, 3, 7]), 9).tolist() == [1, 0, 1]
