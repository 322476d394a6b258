"""The global witness: right integers with "likely", and "unsure" or an error where it cannot know."""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch
from torch import Tensor
from tubes import torus_knot, tube

from topokit.core.cloud import dense, look_at_samples, looks
from topokit.core.cloud import witness as witness_module
from topokit.core.cloud.witness import Witness, global_witness
from topokit.core.local.boundary import BoundaryEstimate
from topokit.core.mesh.sampling import sample_triangles
from topokit.errors import InputError
from topokit.report.cloud_wording import check_sentences, crowding_sentences, preparation_sentences
from topokit.report.verdict import cloud_checks, cloud_verdict
from topokit.testing import genus_mesh, sphere_samples, torus_samples


def sphere(n_points: int = 3000) -> tuple[Tensor, Tensor]:
    known = sphere_samples(n_points)
    return known.points, known.normals


def torus(n_points: int = 3000) -> tuple[Tensor, Tensor]:
    known = torus_samples(n_points)
    return known.points, known.normals


def triple_torus() -> tuple[Tensor, Tensor]:
    vertices, faces = (torch.as_tensor(part) for part in genus_mesh(3))
    samples, _ = sample_triangles(vertices.double(), faces.long(), 6000)
    assert samples.normals is not None
    return samples.points, samples.normals


def shell() -> tuple[Tensor, Tensor]:
    (outer, out), (inner, away) = sphere(), sphere(1500)
    return torch.cat((outer, 0.55 * inner)), torch.cat((out, -away))


def sphere_and_torus() -> tuple[Tensor, Tensor]:
    (points, normals), (ring, ring_normals) = sphere(2000), torus(3000)
    return torch.cat((points, ring + torch.tensor([3.0, 0, 0]))), torch.cat((normals, ring_normals))


NO_BOUNDARY = BoundaryEstimate((), 0.0, 1.0)


def verdict(found: Witness) -> str:
    return cloud_verdict(cloud_checks(found, NO_BOUNDARY))


def failed(found: Witness) -> set[str]:
    return {check.name for check in cloud_checks(found, NO_BOUNDARY) if not check.passed}


SHAPES = [
    (sphere, 2, (1, 0)),
    (torus, 0, (1, 0)),
    (triple_torus, -4, (1, 0)),
    (shell, 4, (1, 1)),
    (sphere_and_torus, 2, (2, 0)),
]


@pytest.mark.parametrize("is_oriented", [True, False])
@pytest.mark.parametrize(("make", "euler", "parts"), SHAPES, ids=lambda value: getattr(value, "__name__", str(value)))
def test_smooth_shapes_are_right_and_likely(make: type, euler: int, parts: tuple[int, int], is_oriented: bool) -> None:
    points, normals = make()
    found = global_witness(points, normals if is_oriented else None)
    assert (found.euler, verdict(found)) == (euler, "likely"), failed(found)
    assert (found.components, found.cavities) == parts
    assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.99
    assert {value for vote in found.votes for value in vote.eulers} == {euler}
    assert 2.5 * found.spacing <= found.resolution < 5 * found.spacing


def test_reasons_are_sentences_with_numbers() -> None:
    found = global_witness(sphere(1500)[0])
    checked = check_sentences(cloud_checks(found, NO_BOUNDARY), found)
    sentences = (*checked[0], *checked[1], *crowding_sentences(found), *preparation_sentences(found))
    assert len(sentences) > 5
    for sentence in sentences:
        assert sentence[0].isupper() or sentence[0].isdigit()
        assert sentence.endswith(".")
        assert re.search(r"\d", sentence)
        assert not re.search(r"sigma|alternation|setting|cut \d|grid \d|_|[{}]", sentence), sentence


def test_inward_normals_are_reversed() -> None:
    points, normals = torus()
    found = global_witness(points, -3 * normals)
    assert (found.euler, verdict(found)) == (0, "likely")
    assert found.signs.source == "reversed"
    np.testing.assert_allclose(found.normals, normals.numpy(), atol=1e-12)


def test_contradictory_normals_are_found_anew() -> None:
    points, normals = sphere()
    flipped = torch.where(points[:, :1] > 0.5, -normals, normals)
    found = global_witness(points, flipped)
    assert found.signs.source == "contradictory"
    assert found.signs.confirmed == pytest.approx(float((points[:, 0] <= 0.5).double().mean()), abs=0.03)
    assert failed(found) == {"contradictory"}
    assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.99


def test_neither_offset_nor_unit_matters() -> None:
    points, normals = torus()
    plain = global_witness(points, normals)
    for scale, shift in ((1.0, 1e6), (1e-6, 0.0), (1e7, 0.0)):
        moved = global_witness(points * scale + shift, normals)
        assert (moved.euler, failed(moved)) == (plain.euler, failed(plain))
        assert moved.spacing == pytest.approx(scale * plain.spacing, rel=1e-4)
        assert moved.votes == plain.votes


def test_given_areas_are_used() -> None:
    known = sphere_samples(3000, radius=50.0)
    areas = torch.full((3000,), known.area / 3000)
    found = global_witness(known.points.float(), known.normals.float(), areas)
    assert (found.euler, verdict(found)) == (2, "likely")
    assert found.spacing == pytest.approx((known.area / 3000) ** 0.5, rel=1e-5)


def test_a_thin_sheet_is_unsure() -> None:
    points, normals = sphere()
    flat = points * torch.tensor([1.0, 1.0, 0.02])  # thinner than the spacing of about 0.06
    bent = torch.nn.functional.normalize(normals / torch.tensor([1.0, 1.0, 0.02]), dim=1)
    for given in (bent, None):
        found = global_witness(flat, given)
        assert found.quality.crowded_wide > 0.1
        assert found.quality.crowded_boundary > 0.1
        assert verdict(found) == "unsure"


def test_noise_without_a_surface_is_unsure(generator: torch.Generator) -> None:
    found = global_witness(torch.randn(1500, 3, generator=generator))
    assert {"cuts", "fields"} & failed(found)
    assert verdict(found) == "unsure"


def test_an_open_half_sphere_of_few_points_gets_all_votes() -> None:
    points, normals = sphere(1000)
    upper = points[:, 2] > 0
    found = global_witness(points[upper], normals[upper])
    assert [vote.family for vote in found.votes] == ["cut"] * 3 + ["smooth cut"] * 2 + ["field"] * 3
    assert found.n_used == int(upper.sum())


def test_the_answer_is_deterministic() -> None:
    points, _ = torus(1500)
    first, second = global_witness(points), global_witness(points.clone())
    assert (first.votes, first.quality, first.signs) == (second.votes, second.quality, second.signs)
    np.testing.assert_array_equal(first.normals, second.normals)


def treat_as_large(monkeypatch: pytest.MonkeyPatch, most: int, samples: int) -> None:
    """Treat clouds of more than `most` points as large."""
    monkeypatch.setattr(looks, "MOST_POINTS", most)
    monkeypatch.setattr(dense, "MOST_POINTS", most)
    for module in (look_at_samples, dense):
        monkeypatch.setattr(module, "SAMPLES", samples)


def test_large_clouds_are_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    treat_as_large(monkeypatch, 5000, 3000)
    points, normals = torus(8000)
    for given, source in ((normals, "given"), (None, "none"), (-normals, "reversed")):
        found = global_witness(points, given)
        assert (found.euler, verdict(found), found.signs.source) == (0, "likely", source), failed(found)
        assert found.is_downsampled
        assert 2500 < found.n_used <= 3000
        assert {vote.n_samples for vote in found.votes if vote.family == "coarse cut"} != {found.n_used}
        expected = f"Normals come from all 8000 points, the integer from {found.n_used}"
        assert preparation_sentences(found)[0].startswith(expected)
        assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.99


def test_the_order_of_a_large_cloud_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    treat_as_large(monkeypatch, 5000, 3000)
    monkeypatch.setattr(witness_module, "MOST_POINTS", 5000)
    points, _ = torus(8000)
    order = torch.randperm(8000, generator=torch.Generator().manual_seed(1))
    first, second = global_witness(points), global_witness(points[order])
    assert first.votes == second.votes
    assert np.allclose(first.normals[order.numpy()], second.normals)
    assert first.surface is not None
    assert second.surface is not None
    assert np.array_equal(first.surface.points, order.numpy()[second.surface.points])


def test_large_clouds_with_nested_walls_thinning_and_duplicates(monkeypatch: pytest.MonkeyPatch) -> None:
    treat_as_large(monkeypatch, 2500, 2000)
    monkeypatch.setattr(dense, "MOST_DENSE", 4000)
    points, normals = shell()
    doubled, both = points.repeat(2, 1), normals.repeat(2, 1)
    found = global_witness(doubled)
    assert (found.euler, found.components, found.cavities) == (4, 1, 1)
    assert found.normals.shape == doubled.shape
    assert ((torch.from_numpy(found.normals) * both).sum(1) > 0).double().mean() > 0.99


@pytest.mark.parametrize("is_large", [False, True])
def test_a_small_bubble_in_a_solid_is_a_cavity(monkeypatch: pytest.MonkeyPatch, is_large: bool) -> None:
    """Its normals, carried along its own surface, point out of the bubble and not into it."""
    if is_large:
        treat_as_large(monkeypatch, 5000, 3000)
    bubble = 0.12 * sphere_samples(120).points + torch.tensor([0.3, 0, 0])
    found = global_witness(torch.cat((sphere_samples(8000).points, bubble)))
    assert (found.euler, found.components, found.cavities) == (4, 1, 1)
    inward = torch.tensor([0.3, 0, 0]) - bubble
    assert ((torch.from_numpy(found.normals)[-120:] * inward).sum(1) > 0).double().mean() > 0.99


def test_contradictory_normals_of_a_large_cloud_are_found_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    treat_as_large(monkeypatch, 5000, 3000)
    points, normals = torus(8000)
    flipped = torch.where(points[:, :1] > 0.5, -normals, normals)
    found = global_witness(points, flipped)
    assert found.signs.source == "contradictory"
    assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.99


def test_noise_larger_than_the_spacing_is_averaged(monkeypatch: pytest.MonkeyPatch, generator: torch.Generator) -> None:
    treat_as_large(monkeypatch, 3000, 2000)
    points, normals = torus(40_000)
    noisy = points + 0.03 * torch.randn(points.shape, generator=generator)  # twice the spacing
    found = global_witness(noisy)
    assert (found.euler, found.preparation) == (0, "averaged")
    assert found.quality.roughness < 0.5
    assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.95
    assert "averaged over their neighbors" in preparation_sentences(found)[0]


def test_noise_wider_than_many_neighborhoods_leaves_few_samples_and_is_unsure(
    monkeypatch: pytest.MonkeyPatch, generator: torch.Generator
) -> None:
    treat_as_large(monkeypatch, 3000, 2000)
    points, normals = sphere(40_000)
    found = global_witness(points * (1 + 0.1 * torch.randn(len(points), 1, generator=generator)))
    assert (found.euler, found.preparation) == (2, "thinned")
    assert found.n_used <= 1000
    assert verdict(found) == "unsure"
    assert "details are lost with the noise" in " ".join(check_sentences(cloud_checks(found, NO_BOUNDARY), found)[0])
    assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.95


def test_large_wires_are_read_from_evenly_spread_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looks, "MOST_POINTS", 2000)
    monkeypatch.setattr(looks, "_WIRE_SAMPLES", 1500)
    points, outward = tube(torus_knot(2, 3), 0.02, 3000)
    found = global_witness(torch.from_numpy(points))
    assert (found.euler, found.components, found.preparation) == (0, 1, "wire")
    assert found.wire is not None
    assert found.surface is None
    assert found.n_used <= 1500
    assert (found.normals * outward).sum(1).mean() > 0.8
    assert preparation_sentences(found)[0] == f"{found.n_used} evenly spread samples of the 3000 points were used."


def test_repeated_points_are_left_out() -> None:
    points, normals = sphere(1500)
    found = global_witness(points.repeat(4, 1), normals.repeat(4, 1))
    assert (found.euler, verdict(found)) == (2, "likely")
    assert preparation_sentences(found)[0] == "4500 points that coincide with others were left out."
    assert found.normals.shape == (6000, 3)
    with pytest.raises(InputError, match="too few"):
        global_witness(points[:20].repeat(30, 1))


DEGENERATE = {
    "plane": torch.cat((torch.rand(500, 2), torch.zeros(500, 1)), 1),
    "tilted plane": torch.rand(500, 2).double() @ torch.tensor([[1.0, 2, 3], [0, 1, -1]]).double(),
    "line": torch.rand(500, 1) * torch.ones(3),
    "one point": torch.zeros(1, 3),
    "two points": torch.eye(3)[:2],
    "all equal": torch.ones(500, 3),
    "nan": torch.full((500, 3), torch.nan),
    "nothing": torch.zeros(0, 3),
    "two-dimensional": torch.rand(500, 2),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_clouds_are_refused(name: str) -> None:
    with pytest.raises(InputError):
        global_witness(DEGENERATE[name])


def test_ill_fitting_normals_and_areas_are_refused() -> None:
    points, normals = sphere(100)
    with pytest.raises(InputError, match="normals have shape"):
        global_witness(points, normals[:50])
    with pytest.raises(InputError, match="normals are not finite"):
        global_witness(points, normals * torch.nan)
    with pytest.raises(InputError, match="areas have shape"):
        global_witness(points, normals, torch.ones(50))
