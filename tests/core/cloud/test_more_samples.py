"""More samples of a large cloud: taken where all their cuts agree, and only there."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from topokit.core.cloud import dense, look_at_samples, looks, more_samples
from topokit.core.cloud.axes import surface_axes
from topokit.core.cloud.dense import DenseCloud, dense_cloud
from topokit.core.cloud.neighborhoods import local_geometry, local_spacings
from topokit.core.cloud.votes import Vote
from topokit.core.cloud.witness import global_witness

Floats = NDArray[np.float64]


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Budgets a tenth as large as they are."""
    for module in (looks, dense):
        monkeypatch.setattr(module, "MOST_POINTS", 3_000)
    for module in (look_at_samples, dense):
        monkeypatch.setattr(module, "SAMPLES", 2_000)
    monkeypatch.setattr(more_samples, "MORE_SAMPLES", 4_000)


def torus(n_points: int) -> tuple[Floats, Floats]:
    """Random samples (n, 3) of a torus, and outward normals; χ = 0."""
    u, v = np.random.default_rng(0).uniform(0, 2 * np.pi, (2, n_points))
    normals = np.column_stack((np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)))
    return 0.4 * normals + np.column_stack((np.cos(u), np.sin(u), 0 * u)), normals


def with_signs(points: Floats) -> DenseCloud:
    return dense_cloud(points, surface_axes(points))


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("are_found", [False, True])
def test_samples_that_agree_bring_the_votes_of_all_settings(are_found: bool) -> None:
    points, normals = torus(5_000)
    found = more_samples.more_samples(with_signs(points), normals, are_found=are_found)
    assert found is not None
    assert 2_000 < len(found.kept) <= 4_000
    assert [vote.eulers for vote in found.votes] == [(0, 0)] * 3
    fewer = [Vote("cut", k, (2 * k,)) for k in range(3)] + [Vote("coarse cut", 0, (9,)), Vote("field", 1, (4,))]
    families = [(vote.family, vote.eulers) for vote in found.with_votes_of_fewer(fewer)]
    assert families[3:] == [("coarse cut", (0,)), ("coarse cut", (2,)), ("field", (4,))]


@pytest.mark.usefixtures("few")
def test_there_are_none_of_few_points_or_where_cuts_differ() -> None:
    points, normals = torus(5_000)
    assert more_samples.more_samples(with_signs(points[:3_999]), normals[:3_999], are_found=False) is None
    signs = np.where(np.random.default_rng(1).random(len(points)) < 0.4, -1.0, 1.0)
    assert more_samples.more_samples(with_signs(points), normals * signs[:, None], are_found=False) is None


@pytest.mark.usefixtures("few")
def test_signs_of_empty_spheres_that_would_change_the_integer_refuse_them(monkeypatch: pytest.MonkeyPatch) -> None:
    points, normals = torus(5_000)
    monkeypatch.setattr(more_samples, "normals_by_poles", lambda complex_, outward, cut, rounds: (outward, cut))
    assert more_samples.more_samples(with_signs(points), normals, are_found=True) is not None
    other = more_samples.cut_complex

    def reversed_poles(complex_, outward, cut, rounds):  # type: ignore[no-untyped-def]
        return -outward, other(complex_, -outward)

    monkeypatch.setattr(more_samples, "normals_by_poles", reversed_poles)
    assert more_samples.more_samples(with_signs(points), normals, are_found=True) is None
    assert more_samples.more_samples(with_signs(points), normals, are_found=False) is not None


@pytest.mark.usefixtures("few")
def test_a_cloud_of_which_fewer_samples_show_too_little() -> None:
    witness = global_witness(torch.from_numpy(perforated_plate(20_000)))
    assert witness.euler == 2 - 2 * 25
    assert 2_000 < witness.n_used <= 4_000
    assert not witness.is_widened
    eulers = {vote.n_samples > 2_000: vote.eulers for vote in witness.votes if vote.family != "field"}
    assert eulers[True] == (witness.euler,) * 2 != eulers[False]
    assert witness.quality.coverage > 0.9
    assert witness.surface is not None
    assert witness.surface.euler == witness.euler


def perforated_plate(n_points: int, holes: int = 5, thickness: float = 0.15) -> Floats:
    """Random samples (n, 3) of a square plate with rows of round holes; χ = 2 − 2 holes²."""
    random = np.random.default_rng(0)
    half, radius = holes / 2, 0.3
    size = np.array([2 * (4 * half**2 - holes**2 * np.pi * radius**2), 8 * half * thickness])
    size = np.append(size, 2 * np.pi * radius * thickness * holes**2)
    n_faces, n_sides, n_walls = random.multinomial(n_points, size / size.sum())
    flat = random.uniform(-half, half, (3 * n_faces, 2))
    flat = flat[np.hypot(*((flat + half) % 1 - 0.5).T) > radius][:n_faces]
    faces = np.column_stack((flat, random.choice([-0.5, 0.5], len(flat)) * thickness))
    along, end = random.uniform(-half, half, n_sides), random.choice([-half, half], n_sides)
    is_x, height = random.random(n_sides) < 0.5, random.uniform(-0.5, 0.5, n_sides) * thickness
    sides = np.column_stack((np.where(is_x, end, along), np.where(is_x, along, end), height))
    angle, cell = random.uniform(0, 2 * np.pi, n_walls), random.integers(0, holes, (n_walls, 2)) + 0.5 - half
    walls = cell + radius * np.column_stack((np.cos(angle), np.sin(angle)))
    return np.concatenate((faces, sides, np.column_stack((walls, random.uniform(-0.5, 0.5, n_walls) * thickness))))


@pytest.mark.usefixtures("few")
def test_a_cloud_off_any_surface_is_not_looked_at_through_other_samples() -> None:
    side = np.arange(80.0)
    lattice = np.stack(np.meshgrid(side, side, [0.0]), -1).reshape(-1, 3)
    lattice[0, 2] = 1.0
    witness = global_witness(torch.from_numpy(lattice))
    assert witness.preparation == "sampled"
    assert witness.agreement < 1
    assert witness.quality.coverage < 0.5
    assert not witness.is_widened
    assert not [vote for vote in witness.votes if vote.family == "shifted cut"]


def test_spacings_alone_are_those_of_whole_neighborhoods() -> None:
    points, _ = torus(1_000)
    assert np.array_equal(local_spacings(points), local_geometry(points).spacings)
    assert np.array_equal(local_spacings(points[:6]), local_geometry(points[:6]).spacings)
