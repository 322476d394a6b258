"""Where votes differ: all points there, shifted ones at thin walls and narrow gaps, smoothed ones of noisy surfaces."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from topokit.core.cloud import retries
from topokit.core.cloud.normals.patches import neighborhoods_of, patches_of
from topokit.core.cloud.reconstruction import Cloud, Reconstruction, reconstruct
from topokit.core.cloud.retries import clearances
from topokit.core.cloud.settings import CloudSettings, QualitySettings, SamplingSettings, ShiftSettings
from topokit.core.cloud.solid.tetrahedra import cut_complex
from topokit.core.cloud.votes import Vote, values_of
from topokit.core.cloud.witness import Witness, global_witness
from topokit.testing import sphere_samples

Floats = NDArray[np.float64]
SETTINGS = CloudSettings()
FEW = CloudSettings(sampling=SamplingSettings(whole=3000, samples=2000))


def plate_with_hole(n: int, thickness: float, *, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Random samples (n, 3) of a square plate with a round hole, and outward normals; χ = 0."""
    random = np.random.default_rng(seed)
    half, radius = 1.0, 0.4
    areas = np.array([2 * (4 * half**2 - np.pi * radius**2), 8 * half * thickness, 2 * np.pi * radius * thickness])
    n_faces, n_sides, n_hole = random.multinomial(n, areas / areas.sum())
    flat = random.uniform(-half, half, (3 * n_faces, 2))
    flat = flat[np.hypot(*flat.T) > radius][:n_faces]
    side = random.choice([-1.0, 1.0], n_faces)
    faces = np.column_stack((flat, side * thickness / 2))
    which, along = random.integers(0, 4, n_sides), random.uniform(-half, half, n_sides)
    height, one = random.uniform(-thickness / 2, thickness / 2, n_sides), np.where(which % 2, half, -half)
    x, y = np.where(which < 2, one, along), np.where(which < 2, along, one)
    sides = np.column_stack((x, y, height))
    side_normals = np.column_stack((np.where(which < 2, np.sign(one), 0), np.where(which < 2, 0, np.sign(one)), 0 * x))
    angle = random.uniform(0, 2 * np.pi, n_hole)
    ring = np.column_stack((np.cos(angle), np.sin(angle), 0 * angle))
    hole = radius * ring + np.column_stack((0 * angle, 0 * angle, random.uniform(-1, 1, n_hole) * thickness / 2))
    normals = np.concatenate((side[:, None] * np.array([0, 0, 1.0]), side_normals, -ring))
    return np.concatenate((faces, sides, hole)), normals


def test_clearances_of_parallel_sheets() -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(12.0), np.arange(12.0)))
    points = np.concatenate([np.column_stack((x, y, 0 * x + height)) for height in (0.0, 0.5)])
    up = np.repeat([[0, 0, 1.0]], len(x), axis=0)
    inner = np.flatnonzero(((points[:, :2] > 2) & (points[:, :2] < 9)).all(1))
    local = neighborhoods_of(points, SETTINGS.patches)
    for normals, near, far in (
        (np.concatenate((-up, up)), 0, 1),  # outward: a wall of that thickness
        (np.concatenate((up, -up)), 1, 0),  # inward: a gap of that width
    ):
        found = clearances(normals, local, SETTINGS)
        distance = found[near][inner] * local.spacings[inner]
        assert np.allclose(distance, 0.5, atol=0.05)
        assert (found[far][inner] == 3).all()


def test_plate_much_thinner_than_the_spacing() -> None:
    witness = seen_thin_plate()
    assert witness.is_shifted
    assert witness.euler == 0
    assert witness.agreement > 0.8  # of thirteen counts, at most two differ


def test_samples_without_signs_stay() -> None:
    points, _ = plate_with_hole(1_000, 0.028)
    assert not global_witness(torch.from_numpy(points)).is_shifted


def test_samples_are_shifted_by_the_lengths_of_the_settings() -> None:
    points, normals = plate_with_hole(1_000, 0.014)
    settings, usual = CloudSettings(shifts=ShiftSettings(lengths=(0.1,))), seen_thin_plate()
    short = global_witness(torch.from_numpy(points), torch.from_numpy(normals), settings=settings)
    assert short.quality != usual.quality or short.votes != usual.votes
    assert usual.agreement >= short.agreement


def test_unanimous_votes_are_left_alone() -> None:
    points, normals = plate_with_hole(2_000, 0.4)
    witness = global_witness(torch.from_numpy(points), torch.from_numpy(normals))
    assert not witness.is_shifted
    assert (witness.euler, witness.agreement) == (0, 1)


def test_found_normals_are_corrected_where_votes_differ() -> None:
    points, _ = plate_with_hole(2_000, 0.06)
    witness = global_witness(torch.from_numpy(points))
    assert witness.signs.coverage is not None
    assert witness.signs.coverage > 0.97
    assert {vote.family for vote in witness.votes} >= {"cut", "shifted cut"}
    assert witness.euler == 0
    assert witness.agreement > 0.9


def test_a_surface_with_holes_is_not_looked_at_again() -> None:
    plate, _ = plate_with_hole(1_000, 0.07, seed=1)
    cap = sphere_samples(2_000, generator=torch.Generator().manual_seed(0)).points.numpy()
    both = torch.from_numpy(np.concatenate((plate, cap[cap[:, 2] < 0.5] + [4.0, 0.0, 0.0])))
    witness = global_witness(both)
    assert witness.lids is not None
    assert len(witness.lids) == 1
    assert witness.agreement < 1
    assert "shifted cut" not in {vote.family for vote in witness.votes}


def test_samples_without_noise_are_not_smoothed_where_the_surface_misses_them() -> None:
    angle, across = np.random.default_rng(0).uniform([0, -0.28], [2 * np.pi, 0.28], (1_500, 2)).T
    radius = 1 + across * np.cos(angle / 2)
    strip = np.stack((radius * np.cos(angle), radius * np.sin(angle), across * np.sin(angle / 2)), axis=1)
    witness = global_witness(torch.from_numpy(strip))
    assert witness.quality.coverage < 0.97
    assert not witness.is_smoothed


def test_noise_leaves_samples_where_they_are() -> None:
    points, normals = plate_with_hole(1_000, 0.085)
    noise = np.random.default_rng(1).normal(0, 0.014, (len(points), 1))
    witness = global_witness(torch.from_numpy(points + noise * normals))
    assert witness.agreement < 1
    assert not witness.is_shifted
    assert "shifted cut" not in {vote.family for vote in witness.votes}


@pytest.mark.parametrize(
    ("n_points", "thickness", "noise"),
    [(1_000, 0.113, 0.028), pytest.param(2_000, 0.1, 0.02, marks=pytest.mark.long)],  # a third of the spacing
)
def test_noisy_samples_whose_votes_differ_are_looked_at_again(n_points: int, thickness: float, noise: float) -> None:
    points, _ = plate_with_hole(n_points, thickness, seed=3)
    noisy = points + np.random.default_rng(3).normal(0, noise, points.shape)
    witness = global_witness(torch.from_numpy(noisy))
    assert witness.is_smoothed
    assert len(values_of(witness.votes, "field")) == 6  # three of the points, three of the smoothed ones
    assert witness.euler == 0
    assert witness.surface is not None
    assert witness.surface.euler == 0


def test_noisy_samples_whose_votes_agree_are_not() -> None:
    points, _ = plate_with_hole(1_000, 0.5)
    noisy = points + np.random.default_rng(0).normal(0, 0.028, points.shape)
    witness = global_witness(torch.from_numpy(noisy))
    assert witness.quality.coverage < 0.97
    assert witness.agreement == 1
    assert not witness.is_smoothed


def test_noisy_samples_with_lids_over_holes_are_looked_at_again() -> None:
    """Lids over holes of a noisy cloud are a reason, too, though all votes agree."""
    points, _ = plate_with_hole(1_000, 0.5)
    noisy = points + np.random.default_rng(0).normal(0, 0.028, points.shape)
    settings = CloudSettings(quality=QualitySettings(lid=0.0, uncovered=1.0))
    witness = global_witness(torch.from_numpy(noisy), settings=settings)
    assert witness.is_smoothed
    assert witness.agreement == 1
    assert witness.lids


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


def torus(n_points: int) -> tuple[Floats, Floats]:
    """Random samples (n, 3) of a torus, and outward normals; χ = 0."""
    u, v = np.random.default_rng(0).uniform(0, 2 * np.pi, (2, n_points))
    normals = np.column_stack((np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)))
    return 0.4 * normals + np.column_stack((np.cos(u), np.sin(u), 0 * u)), normals


def look(points: Floats, normals: Floats | None = None) -> Reconstruction:
    return reconstruct(Cloud(points, normals, oriented=True), patches_of(points, FEW.patches), FEW)


@cache
def seen_torus(*, are_given: bool) -> Reconstruction:
    """Of 5 000 points, with given normals or with found ones."""
    points, normals = torus(5_000)
    return look(points, normals if are_given else None)


def doubtful(seen: Reconstruction, n_places: int = 20) -> Reconstruction:
    """The same with a cut that calls some tetrahedra inside that the others call outside."""
    flipped = seen.cut.inside.copy()
    flipped[np.flatnonzero(~flipped)[:n_places]] = True
    return replace(seen, cuts=(*seen.cuts, replace(seen.cut, inside=flipped)))


@cache
def seen_thin_plate() -> Witness:
    points, normals = plate_with_hole(1_000, 0.014)  # spacing 0.09
    return global_witness(torch.from_numpy(points), torch.from_numpy(normals))


@pytest.mark.parametrize("are_found", [False, True])
def test_samples_that_agree_bring_the_votes_of_all_settings(are_found: bool) -> None:
    votes = (*(Vote("cut", k, (2 * k,)) for k in range(3)), Vote("coarse cut", 0, (9,)), Vote("field", 0, (0,)))
    before = replace(doubtful(seen_torus(are_given=not are_found)), votes=votes)
    assert before.has_given_signs != are_found
    found = retries._with_all_points_in_doubt(before, FEW)
    assert found is not None
    samples = found.cloud.samples
    assert len(before.cloud.samples.kept) < len(samples.kept) <= 2 * FEW.sampling.samples
    assert [(vote.family, vote.eulers) for vote in found.votes] == [
        *[("cut", (0, 0))] * 3,
        *[("coarse cut", (2 * k,)) for k in range(3)],
        ("field", (0,)),
    ]
    np.testing.assert_array_equal(found.cloud.complex_.points.shape, (len(samples.kept), 3))
    length = found.quality.roughness * found.cloud.local.spacing
    assert length == pytest.approx(before.quality.roughness * before.cloud.local.spacing)


def test_all_points_of_the_cloud_are_looked_at_where_cuts_differ() -> None:
    before = doubtful(seen_torus(are_given=True), 3)
    found = retries._with_all_points_in_doubt(before, FEW)
    assert found is not None
    kept, owner = found.cloud.samples.kept, found.cloud.samples.owner
    in_doubt = retries._in_doubt(before, FEW)[before.cloud.samples.owner]
    added = np.setdiff1d(kept, before.cloud.samples.kept)
    np.testing.assert_array_equal(np.flatnonzero(in_doubt), np.flatnonzero(in_doubt & np.isin(np.arange(5_000), kept)))
    assert 0 < len(added) < 1_000
    assert in_doubt[added].all()
    np.testing.assert_array_equal(kept[owner[kept]], kept)
    unchanged = ~in_doubt
    np.testing.assert_array_equal(
        kept[owner[unchanged]], before.cloud.samples.kept[before.cloud.samples.owner[unchanged]]
    )


def test_there_are_none_of_few_points_or_where_cuts_agree_or_go_on_to_differ() -> None:
    points, normals = torus(5_000)
    assert retries._with_all_points_in_doubt(look(points[:2_000], normals[:2_000]), FEW) is None
    seen = doubtful(seen_torus(are_given=True))
    refuted = replace(seen, votes=(Vote("field", 0, (4,)), Vote("field", 1, (2,))))
    assert retries._with_all_points_in_doubt(refuted, FEW) is None
    same = replace(seen, cuts=(seen.cut, seen.cut))
    assert retries._with_all_points_in_doubt(same, FEW) is None
    signs = np.where(np.random.default_rng(1).random(len(points)) < 0.4, -1.0, 1.0)
    wrong = replace(seen, cloud=replace(seen.cloud, normals=normals * signs[:, None]))
    assert retries._with_all_points_in_doubt(wrong, FEW) is None
    assert retries._with_all_points_in_doubt(seen, FEW) is not None


def test_signs_of_empty_spheres_that_would_change_the_integer_refuse_them(monkeypatch: pytest.MonkeyPatch) -> None:
    given, found = (doubtful(seen_torus(are_given=are_given)) for are_given in (True, False))

    def reversed_poles(complex_, outward, cut, weights, rounds):  # type: ignore[no-untyped-def]
        return -outward, cut_complex(complex_, -outward, weights)

    monkeypatch.setattr(retries, "normals_by_poles", reversed_poles)
    assert retries._with_all_points_in_doubt(found, FEW) is None
    assert retries._with_all_points_in_doubt(given, FEW) is not None


def test_a_cloud_of_which_fewer_samples_show_too_little() -> None:
    witness = global_witness(torch.from_numpy(perforated_plate(20_000)), settings=FEW)
    assert witness.euler == 2 - 2 * 25
    assert 2_000 < witness.n_used <= 4_000
    assert not witness.is_shifted
    eulers = {vote.n_samples > 2_000: vote.eulers for vote in witness.votes if vote.family != "field"}
    assert eulers[True] == (witness.euler,) * 2 != eulers[False]
    assert witness.quality.coverage > 0.9
    assert witness.surface is not None
    assert witness.surface.euler == witness.euler


def test_a_cloud_off_any_surface_is_not_looked_at_through_other_samples() -> None:
    side = np.arange(80.0)
    lattice = np.stack(np.meshgrid(side, side, [0.0]), -1).reshape(-1, 3)
    lattice[0, 2] = 1.0
    witness = global_witness(torch.from_numpy(lattice), settings=FEW)
    assert witness.preparation == "sampled"
    assert witness.agreement < 1
    assert witness.quality.coverage < 0.5
    assert not witness.is_shifted
    assert not [vote for vote in witness.votes if vote.family == "shifted cut"]


def test_the_surface_is_that_of_the_first_cut_with_the_integer() -> None:
    seen = seen_torus(are_given=True)
    filled = replace(seen.cut, inside=np.ones_like(seen.cut.inside))  # the hull
    empty = replace(seen.cut, inside=~filled.inside)
    both = replace(seen, cuts=(filled, empty, seen.cut))
    assert both.cut_with(0) is seen.cut
    assert both.cut_with(2) is both.cut_with(-8) is filled
