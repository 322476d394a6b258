"""Counts of labeled tetrahedra against counts of their simplices one by one."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from topokit.core.cloud.solid.counts import solid_eulers
from topokit.core.cloud.solid.tetrahedra import delaunay_complex, facets_at


def euler_of(tetrahedra: set[tuple[int, ...]]) -> int:
    """χ of the simplicial complex of tetrahedra and all their faces."""
    faces = {face for one in tetrahedra for size in range(1, 5) for face in combinations(sorted(one), size)}
    return sum((-1) ** (len(face) - 1) for face in faces)


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("n_points", [5, 30, 300])
def test_both_sides_count_as_their_simplices(n_points: int, share: float) -> None:
    rng = np.random.default_rng(n_points)
    complex_ = delaunay_complex(rng.normal(size=(n_points, 3)), np.full(n_points, 0.3))
    inside = rng.random(len(complex_.tetrahedra)) < share
    within = {tuple(one) for one in complex_.tetrahedra[inside].tolist()}
    beyond = {tuple(one) for one in complex_.tetrahedra[~inside].tolist()}
    beyond |= {
        (*facet, n_points) for facet in facets_at(complex_.tetrahedra, *np.nonzero(complex_.neighbors < 0)).tolist()
    }
    assert solid_eulers(complex_, inside) == (euler_of(within), euler_of(beyond))
