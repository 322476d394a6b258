"""Points in boxes, against every pair looked at."""

from __future__ import annotations

import numpy as np
import pytest

from topokit.core.mesh import boxes
from topokit.core.mesh.boxes import boxes_around


@pytest.mark.parametrize("n_dimensions", [2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_all_pairs_are_found_once(seed: int, n_dimensions: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(boxes, "_PAIRS", 50)  # several pieces
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(300, n_dimensions))
    low = rng.normal(size=(200, n_dimensions))
    high = low + np.exp(rng.uniform(-14, 2.5, (200, 1))) * rng.random((200, n_dimensions))
    low[:5], high[:5] = points[:5], points[:5]  # boxes without extent
    point_groups, box_groups = rng.integers(0, 3, 300), rng.integers(0, 3, 200)
    holds = ((low[None] <= points[:, None]) & (points[:, None] <= high[None])).all(-1)
    expected = np.argwhere(holds & (point_groups[:, None] == box_groups[None]))
    pieces = list(boxes_around(points, low, high, point_groups, box_groups))
    found = np.concatenate([np.stack(piece, axis=1) for piece in pieces])
    assert len(pieces) > 1
    assert len(expected) > 20
    assert sorted(map(tuple, found)) == sorted(map(tuple, expected))


def test_nothing_in_nothing() -> None:
    none, no_groups = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    assert list(boxes_around(none, none, none, no_groups, no_groups)) == []
    assert list(boxes_around(np.ones((2, 3)), none, none, np.zeros(2, dtype=np.int64), no_groups)) == []
