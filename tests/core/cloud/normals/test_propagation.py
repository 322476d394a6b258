"""Signs along the surface: sheets are followed, gaps are not crossed, creases turn, parts enclose positive volumes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from topokit.core.cloud.normals import propagation
from topokit.core.cloud.normals.creases import find_faces
from topokit.core.cloud.normals.patch_graph import relative_signs
from topokit.core.cloud.normals.patches import Patches, patches_of
from topokit.core.cloud.normals.propagation import Propagation, propagate_signs
from topokit.core.cloud.settings import CreaseSettings, PatchSettings, SignSettings
from topokit.testing import sphere_samples, torus_samples

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def plate(n_points: int, thickness: float) -> tuple[Floats, Floats]:
    """A flat closed box: two faces and a rim of semicircles would be smoother, but sharp edges are the harder case."""
    random = np.random.default_rng(0)
    sides = np.array([1.0, 1.0, thickness])
    areas = np.array([thickness, thickness, 1.0])
    axis = random.choice(3, n_points, p=areas / areas.sum())
    points = random.random((n_points, 3)) * sides
    upper = random.random(n_points) < 0.5
    rows = np.arange(n_points)
    points[rows, axis] = np.where(upper, sides[axis], 0.0)
    normals = np.zeros((n_points, 3))
    normals[rows, axis] = np.where(upper, 1.0, -1.0)
    return points - sides / 2, normals


def around(points: Floats) -> Patches:
    return patches_of(points, PatchSettings())


def signed(
    surface: Patches, axes: Floats | None = None, *, by_vote: bool = True, settings: SignSettings | None = None
) -> Propagation:
    axes = surface.planes.axes if axes is None else axes
    return propagate_signs(
        surface.points, axes, surface.areas(), surface.neighbors, by_vote=by_vote, settings=settings or SignSettings()
    )


def share_right(points: Floats, normals: Floats) -> float:
    return float(((signed(around(points)).normals * normals).sum(1) > 0).mean())


def test_smooth_surfaces_are_oriented_outward() -> None:
    for known in (sphere_samples(5000), torus_samples(8000)):
        assert share_right(known.points.numpy(), known.normals.numpy()) == 1.0


def test_a_thin_plate_is_oriented_across_its_edges() -> None:
    points, normals = plate(60_000, 0.03)  # the faces are five spacings apart
    assert share_right(points, normals) > 0.99


def test_right_angles_between_exact_faces_are_crossed() -> None:
    points, normals = plate(40_000, 0.5)
    found = signed(around(points), normals * np.random.default_rng(1).choice([-1.0, 1.0], len(points))[:, None])
    assert ((found.normals * normals).sum(1) > 0).all()
    spread = [np.ptp(normals[found.patches == patch], axis=0).max() for patch in np.unique(found.patches)]
    assert 6 <= len(spread) < 12
    assert max(spread) == 0


def test_rough_points_are_cut_into_a_bounded_number_of_patches(monkeypatch: pytest.MonkeyPatch) -> None:
    known = sphere_samples(5000)
    random = np.random.default_rng(0)
    points = known.points.numpy() * (1 + 0.005 * random.normal(size=(5000, 1)))
    surface, counts = around(points), list[int]()

    def counted(count: int, first: Integers, second: Integers, votes: Floats) -> Floats:
        counts.append(count)
        return relative_signs(count, first, second, votes)

    monkeypatch.setattr(propagation, "relative_signs", counted)
    for settings in (SignSettings(), SignSettings(most_patches=50)):
        found = signed(surface, settings=settings)
        assert ((found.normals * known.normals.numpy()).sum(1) > 0).mean() > 0.999
    assert counts[0] > 500
    assert counts[1] == 51


def test_the_number_of_patches_is_bounded_where_all_steps_weigh_the_same() -> None:
    is_within = propagation._within_patches(np.full(1000, 0.3), SignSettings(most_patches=50))
    assert np.count_nonzero(~is_within) == 50


def test_noisy_points_are_not_asked_to_vote() -> None:
    known = sphere_samples(20_000)
    spacing = (known.area / 20_000) ** 0.5
    points = known.points.numpy() * (1 + 0.3 * spacing * np.random.default_rng(0).normal(size=(20_000, 1)))
    surface, wrong = around(points), {}
    assert not find_faces(surface, CreaseSettings()).show  # which decides
    for by_vote in (False, True):
        found = signed(surface, by_vote=by_vote)
        wrong[by_vote] = int(((found.normals * known.normals.numpy()).sum(1) < 0).sum())
    assert wrong[False] < 0.001 * len(points)
    assert wrong[False] < wrong[True]


def test_parts_are_told_apart_and_each_turned_outward() -> None:
    sphere, ring = sphere_samples(3000), torus_samples(5000)
    points = np.concatenate((sphere.points.numpy() - [5.0, 0, 0], ring.points.numpy()))
    normals = np.concatenate((sphere.normals.numpy(), ring.normals.numpy()))
    found = signed(around(points))
    assert len(np.unique(found.parts[:3000])) == len(np.unique(found.parts[3000:])) == 1
    assert found.parts[0] != found.parts[-1]
    assert ((found.normals * normals).sum(1) > 0).all()


def row_of_spheres(count: int, n_points: int) -> tuple[Floats, Floats]:
    """Even samples of spheres in a row, of radius 1 … 0.01, each as near to the next as it is wide; normals."""
    points, normals, place = [], [], 0.0
    for number, radius in enumerate(np.geomspace(1, 0.01, count)):
        one = sphere_samples(n_points, generator=torch.Generator().manual_seed(number)).points.numpy()
        points.append(radius * one + [place + radius, 0, 0])
        normals.append(one)
        place += 4 * radius
    return np.concatenate(points), np.concatenate(normals)


@pytest.mark.parametrize("middle", [0.0, 1e3])
def test_small_parts_far_from_the_middle_are_turned_outward(middle: float) -> None:
    """About another point than the part's own, rounded areas outweigh the volume that a small part encloses."""
    points, normals = row_of_spheres(20, 300)
    found = signed(around(points + np.array([middle, 0, 0])))
    assert found.parts.max() + 1 == 20
    assert ((found.normals * normals).sum(1) > 0).all()
