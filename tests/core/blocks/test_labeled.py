"""All labels in one pass are counted as each by itself: χ, surfaces with boxes, areas and nesting, Betti numbers."""

from __future__ import annotations

from dataclasses import fields, is_dataclass

import numpy as np
import pytest
import torch

from topokit.core.blocks.labeled import count_labels
from topokit.core.blocks.whole import count_solid
from topokit.core.grid.grid import Grid

random = np.random.default_rng(4)
RANDOM = [
    random.integers(0, 4, (5, 7, 6)),  # pieces that touch at corners
    np.kron(random.integers(0, 3, (4, 3, 4)), np.ones((2, 2, 2), int)),
    np.where(random.random((9, 8, 9)) < 0.08, 0, 5) + 2 * (random.random((9, 8, 9)) < 0.05),  # cavities
    random.integers(-1, 2, (1, 6, 1)).astype(np.int8),
    np.full((3, 2, 4), 2**40, np.uint64),
]
NESTED = np.zeros((11, 11, 11), np.uint16)
for layers, label in enumerate((3, 0, 3, 300, 0, 3)):  # a ball in shells
    NESTED[(slice(layers, 11 - layers),) * 3] = label


def assert_same(one: object, other: object) -> None:
    assert is_dataclass(one)
    for field in fields(one):
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if is_dataclass(mine):
            assert_same(mine, theirs)
        else:
            np.testing.assert_array_equal(mine, theirs, err_msg=field.name)


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("values", [*RANDOM, NESTED], ids=lambda values: str(values.shape))
def test_labels_together_are_those_one_by_one(values: np.ndarray, connectivity: int) -> None:
    grid = Grid(values.shape, (1.0, 0.5, 2.0), (5.0, 0.0, -3.0))
    labels = np.unique(values).astype(np.int64)
    labels = labels[labels > 0]
    for wanted in (labels, labels[:1]):  # what is not wanted is background
        found = count_labels(values, wanted, connectivity, grid)
        for label in wanted.tolist():
            volume = torch.from_numpy(values.astype(np.int64))
            assert_same(found[label], count_solid(volume, lambda part, own=label: part == own, connectivity, grid))


def test_a_shell_in_a_shell_has_nested_surfaces() -> None:
    found = count_labels(NESTED, np.array([3, 300]), 26, Grid(NESTED.shape))
    assert found[3].surfaces.depths.tolist() == [0, 1, 2, 3, 4]
    assert found[300].solid_betti.tolist() == [[1, 0, 1]]
