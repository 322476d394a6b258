"""The boxes of labels, whatever type and range the labels have."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from topokit.core.grid.labels import label_boxes
from topokit.errors import InputError


def naive_box(mask: np.ndarray) -> tuple[slice, ...]:
    where = np.argwhere(mask)
    return tuple(
        slice(max(0, low - 1), min(n, high + 2))
        for low, high, n in zip(where.min(0), where.max(0), mask.shape, strict=True)
    )


@pytest.mark.parametrize("dtype", [torch.uint8, torch.int16, torch.int64, torch.float32, torch.float64])
@pytest.mark.parametrize("names", [(0, 1, 2, 9), (0, 3, 100, 120)])
def test_boxes_are_those_of_each_label(dtype: torch.dtype, names: tuple[int, ...]) -> None:
    values = np.random.default_rng(0).choice(names, size=(7, 6, 9), p=(0.97, 0.01, 0.01, 0.01))
    boxes = label_boxes(torch.from_numpy(values).to(dtype))
    assert boxes == {name: naive_box(values == name) for name in names[1:] if (values == name).any()}
    assert list(boxes) == sorted(boxes)


def test_labels_may_be_negative_and_large() -> None:
    values = torch.zeros(4, 4, 4, dtype=torch.int64)
    values[0, 0, 0], values[2, 2, 2] = -7, 5_000_000_000
    assert label_boxes(values) == {
        -7: (slice(0, 2), slice(0, 2), slice(0, 2)),
        5_000_000_000: (slice(1, 4), slice(1, 4), slice(1, 4)),
    }


def test_nan_is_background_and_gray_values_are_refused() -> None:
    values = torch.full((3, 3, 3), torch.nan)
    assert label_boxes(values) == {}
    values[1, 1, 1] = 2
    assert list(label_boxes(values)) == [2]
    values[0, 0, 0] = 0.5
    with pytest.raises(InputError, match=r"gray values, from 0 to 2; labels are whole numbers"):
        label_boxes(values)
