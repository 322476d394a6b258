"""The union of balls against GUDHI's alpha complex and against shapes of known topology."""

from __future__ import annotations

import numpy as np
import pytest

from topokit.core.cloud.solid.alpha import alpha_complex
from topokit.core.cloud.solid.union_curve import curve_of

CLOUDS = {
    "volume": np.random.default_rng(0).random((400, 3)),
    "sheet": np.random.default_rng(1).random((400, 3)) * [1, 1, 0.02],
    "line": np.random.default_rng(2).random((400, 3)) * [1, 0.02, 0.02],
}


@pytest.mark.parametrize("name", CLOUDS)
def test_radii_equal_gudhi(name: str) -> None:
    gudhi = pytest.importorskip("gudhi")
    points = CLOUDS[name]
    tree = gudhi.AlphaComplex(points=points).create_simplex_tree()
    found = alpha_complex(points)
    for size, radii in ((2, found.edge_radii), (3, found.facet_radii), (4, found.tetrahedron_radii)):
        known = np.sqrt([value for simplex, value in tree.get_filtration() if len(simplex) == size])
        np.testing.assert_allclose(np.sort(radii), np.sort(known), rtol=1e-6)


@pytest.mark.parametrize("radius", [0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("name", CLOUDS)
def test_parts_and_euler_characteristic_equal_gudhi(name: str, radius: float) -> None:
    gudhi = pytest.importorskip("gudhi")
    points = CLOUDS[name]
    tree = gudhi.AlphaComplex(points=points).create_simplex_tree(max_alpha_square=radius**2)
    tree.compute_persistence(persistence_dim_max=True)
    betti = [*tree.betti_numbers(), 0, 0]
    found = alpha_complex(points)
    component, cavities = found.parts(radius)
    radii, eulers = found.euler_curve()
    assert component.max() + 1 == betti[0]
    assert cavities == betti[2]
    assert eulers[np.searchsorted(radii, radius, side="right") - 1] == betti[0] - betti[1] + betti[2]
    assert curve_of(found).at([radius]).betti.tolist() == [betti[:3]]


def test_the_sphere_is_hollow_until_its_radius() -> None:
    direction = np.random.default_rng(0).normal(size=(1500, 3))
    found = alpha_complex(direction / np.linalg.norm(direction, axis=1, keepdims=True))
    assert found.parts(0.5)[1] == 1
    assert found.parts(1.1)[1] == 0
    curve = curve_of(found)
    assert curve.at([0.0, 0.5, 1.1]).betti.tolist() == [[1500, 0, 0], [1, 0, 1], [1, 0, 0]]
    assert curve.euler[-1] == 1
