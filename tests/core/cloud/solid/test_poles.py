"""Signs from the largest empty spheres."""

from __future__ import annotations

import numpy as np
import pytest

from topokit.core.cloud.settings import CutWeights
from topokit.core.cloud.solid.poles import normals_by_poles, outer_poles
from topokit.core.cloud.solid.tetrahedra import cut_complex, delaunay_complex
from topokit.testing import sphere_samples, torus_samples

WEIGHTS = CutWeights()


def test_poles_of_a_sphere() -> None:
    points = sphere_samples(1_000).points.double().numpy()
    poles = outer_poles(delaunay_complex(points, np.full(len(points), 0.1)))
    is_on_hull = poles.tetrahedron == -1
    assert is_on_hull.mean() > 0.9  # all but those that their displacement puts below it
    assert ((poles.way * points).sum(1) > 0.9)[is_on_hull].all()


def test_poles_of_a_torus_are_normal_to_it_and_labels_tell_their_signs() -> None:
    samples = torus_samples(4_000)
    points, normals = samples.points.double().numpy(), samples.normals.double().numpy()
    complex_ = delaunay_complex(points, np.full(len(points), 0.1))
    poles = outer_poles(complex_)
    inner = poles.tetrahedron >= 0
    assert inner.mean() > 0.3
    cosine = (poles.way * normals).sum(1)
    assert np.quantile(np.abs(cosine), 0.05) > 0.9
    assert (cosine[inner] < 0).any()  # centers in the tube, too
    assert ((poles.signed(cut_complex(complex_, normals, WEIGHTS)) * normals).sum(1) > 0).mean() > 0.999


@pytest.mark.parametrize("with_axes", [False, True])
def test_wrong_signs_are_corrected(with_axes: bool) -> None:
    samples = torus_samples(4_000)
    points, normals = samples.points.double().numpy(), samples.normals.double().numpy()
    center = points[np.abs(points[:, 2]).argmin()]
    near = np.linalg.norm(points - center, axis=1) < np.quantile(np.linalg.norm(points - center, axis=1), 0.01)
    wrong = np.where(near[:, None], -normals, normals)  # a patch
    complex_ = delaunay_complex(points, np.full(len(points), 0.1))
    axes = normals if with_axes else None
    found, cut = normals_by_poles(complex_, wrong, cut_complex(complex_, wrong, WEIGHTS), WEIGHTS, rounds=2, axes=axes)
    assert ((found * normals).sum(1) > 0).all()
    assert cut.coverage == 1
    if with_axes:
        assert np.array_equal(found, normals)
