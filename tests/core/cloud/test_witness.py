"""The global witness: right integers with "likely", and "unsure" or an error where it cannot know."""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch
from torch import Tensor
from tubes import torus_knot, tube

import topokit as tk
from topokit.core.cloud.settings import CloudSettings, SamplingSettings, WireSettings
from topokit.core.cloud.witness import Witness, global_witness
from topokit.core.local.boundary import BoundaryEstimate
from topokit.core.mesh.sampling import sample_triangles
from topokit.errors import InputError
from topokit.report.cloud_wording import check_sentences, confidence_sentences, preparation_sentences
from topokit.report.verdict import cloud_checks, cloud_verdict
from topokit.testing import genus_mesh, sphere_samples, torus_samples


def sphere(n_points: int = 1500) -> tuple[Tensor, Tensor]:
    known = sphere_samples(n_points)
    return known.points, known.normals


def torus(n_points: int = 1500) -> tuple[Tensor, Tensor]:
    known = torus_samples(n_points)
    return known.points, known.normals


def triple_torus() -> tuple[Tensor, Tensor]:
    vertices, faces = (torch.as_tensor(part) for part in genus_mesh(3))
    samples, _ = sample_triangles(vertices.double(), faces.long(), 2500)
    assert samples.normals is not None
    return samples.points, samples.normals


def shell() -> tuple[Tensor, Tensor]:
    (outer, out), (inner, away) = sphere(), sphere(800)
    return torch.cat((outer, 0.55 * inner)), torch.cat((out, -away))


def sphere_and_torus() -> tuple[Tensor, Tensor]:
    (points, normals), (ring, ring_normals) = sphere(1000), torus(1500)
    return torch.cat((points, ring + torch.tensor([3.0, 0, 0]))), torch.cat((normals, ring_normals))


NO_BOUNDARY = BoundaryEstimate((), 0.0, 1.0)
LARGE = CloudSettings(sampling=SamplingSettings(whole=2500, samples=1500))


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
    assert 1.9 * found.spacing < found.resolution < 5 * found.spacing


def test_reasons_are_sentences_with_numbers() -> None:
    found = global_witness(sphere(1500)[0])
    checked = check_sentences(cloud_checks(found, NO_BOUNDARY), found)
    sentences = (*checked[0], *checked[1], *confidence_sentences(found, 0.0), *preparation_sentences(found))
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


def test_contradictory_normals_fail_their_check_alone() -> None:
    points, normals = sphere()
    found = global_witness(points, torch.where(points[:, :1] > 0.5, -normals, normals))
    assert found.signs.source == "contradictory"
    assert failed(found) == {"contradictory"}


def test_neither_offset_nor_unit_matters() -> None:
    points, normals = torus()
    plain = global_witness(points, normals)
    for scale, shift in ((1.0, 1e6), (1e-6, 0.0), (1e7, 0.0)):
        moved = global_witness(points * scale + shift, normals)
        assert (moved.euler, failed(moved)) == (plain.euler, failed(plain))
        assert moved.spacing == pytest.approx(scale * plain.spacing, rel=1e-4)
        assert moved.votes == plain.votes


def test_the_spacing_is_in_units_of_length() -> None:
    known = sphere_samples(3000, radius=50.0)
    found = global_witness(known.points.float(), known.normals.float())
    assert (found.euler, verdict(found)) == (2, "likely")
    assert found.spacing == pytest.approx((known.area / 3000) ** 0.5, rel=0.05)


def test_roughness_has_one_unit_for_whole_and_sampled_clouds() -> None:
    known = torus_samples(4000)
    noisy = known.points + 0.003 * torch.randn(4000, 3, generator=torch.Generator().manual_seed(0))
    whole, sampled = global_witness(noisy), global_witness(noisy, settings=LARGE)
    assert (whole.preparation, sampled.preparation) == ("whole", "sampled")
    assert sampled.spacing > 1.3 * whole.spacing
    lengths = [found.quality.roughness * found.spacing for found in (whole, sampled)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-9)
    assert lengths[0] == pytest.approx(0.003, rel=0.5)  # and bending


def test_a_thin_sheet_is_unsure() -> None:
    points, normals = sphere()
    flat = points * torch.tensor([1.0, 1.0, 0.03])  # thinner than the spacing of about 0.09
    bent = torch.nn.functional.normalize(normals / torch.tensor([1.0, 1.0, 0.03]), dim=1)
    for given in (bent, None):
        found = global_witness(flat, given)
        assert found.quality.crowded_wide > 0.1
        assert verdict(found) == "unsure"


def test_noise_without_a_surface_is_unsure(generator: torch.Generator) -> None:
    found = global_witness(torch.randn(400, 3, generator=generator))
    assert {"cuts", "fields"} & failed(found)
    assert verdict(found) == "unsure"


def test_an_open_half_sphere_of_few_points_gets_all_votes() -> None:
    points, normals = sphere(1000)
    upper = points[:, 2] > 0
    found = global_witness(points[upper], normals[upper])
    assert [vote.family for vote in found.votes] == ["cut"] * 3 + ["coarse cut"] * 4 + ["field"] * 3
    assert found.n_used == int(upper.sum())


def test_the_answer_is_deterministic() -> None:
    points, _ = torus(1500)
    first, second = global_witness(points), global_witness(points.clone())
    assert (first.votes, first.quality, first.signs) == (second.votes, second.quality, second.signs)
    np.testing.assert_array_equal(first.normals, second.normals)


def test_large_clouds_are_sampled() -> None:
    points, normals = torus(4000)
    for given, source in ((normals, "given"), (None, "none"), (-normals, "reversed")):
        found = global_witness(points, given, settings=LARGE)
        assert (found.euler, verdict(found), found.signs.source) == (0, "likely", source), failed(found)
        assert found.preparation == "sampled"
        assert 1250 < found.n_used <= 1500
        [fewer] = {vote.n_samples for vote in found.votes if vote.family == "coarse cut"}
        assert 0.4 * found.n_used < fewer < 0.6 * found.n_used
        sentence = preparation_sentences(found)[0]
        assert "4000 points" in sentence
        assert f"{found.n_used} samples" in sentence
        assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.99


@pytest.mark.parametrize(
    "settings", [pytest.param(CloudSettings(), marks=pytest.mark.long), LARGE], ids=["whole", "sampled"]
)
def test_the_order_of_the_points_does_not_matter(settings: CloudSettings) -> None:
    points, _ = torus(3000)
    order = torch.randperm(3000, generator=torch.Generator().manual_seed(1))
    first, second = (global_witness(cloud, settings=settings) for cloud in (points, points[order]))
    assert first.votes == second.votes
    assert np.allclose(first.normals[order.numpy()], second.normals)
    assert first.surface is not None
    assert second.surface is not None
    assert np.array_equal(first.surface.points, order.numpy()[second.surface.points])


def test_large_clouds_with_nested_walls_thinning_and_duplicates() -> None:
    settings = CloudSettings(sampling=SamplingSettings(whole=1500, samples=1200, most_points=2000))
    points, normals = shell()
    doubled, both = points.repeat(2, 1), normals.repeat(2, 1)
    found = global_witness(doubled, settings=settings)
    assert (found.euler, found.components, found.cavities) == (4, 1, 1)
    assert found.normals.shape == doubled.shape
    assert ((torch.from_numpy(found.normals) * both).sum(1) > 0).double().mean() > 0.99


def test_large_wires_are_read_from_evenly_spread_samples() -> None:
    points, outward = tube(torus_knot(2, 3), 0.02, 3000)
    found = global_witness(torch.from_numpy(points), settings=CloudSettings(wires=WireSettings(samples=1500)))
    assert (found.euler, found.components, found.preparation) == (0, 1, "wire")
    assert found.wire is not None
    assert found.surface is None
    assert found.n_used <= 1500
    assert (found.normals * outward).sum(1).mean() > 0.8
    assert f"{found.n_used} evenly spread samples" in preparation_sentences(found)[0]
    assert "3000" in preparation_sentences(found)[0]


@pytest.mark.parametrize(("sign", "source"), [(1.0, "given"), (-1.0, "reversed")])
def test_wires_keep_given_normals(sign: float, source: str) -> None:
    points, outward = tube(torus_knot(2, 3), 0.04, 3000)
    found = global_witness(torch.from_numpy(points), torch.from_numpy(sign * outward))
    assert (found.euler, found.signs.source, found.votes) == (0, source, ())
    assert (found.normals * outward).sum(1).min() > 0.99


def test_averaged_samples_say_so() -> None:
    points, _ = torus(3000)
    found = global_witness(
        points + 0.07 * torch.randn(3000, 3, generator=torch.Generator().manual_seed(0)), settings=LARGE
    )
    assert found.preparation == "averaged"
    sentence = preparation_sentences(found)[0]
    assert "3000 points" in sentence
    assert str(found.n_used) in sentence


def test_repeated_points_are_left_out() -> None:
    points, normals = sphere(1500)
    found = global_witness(points.repeat(4, 1), normals.repeat(4, 1))
    assert (found.euler, verdict(found)) == (2, "likely")
    assert "4500 points" in preparation_sentences(found)[0]
    assert found.normals.shape == (6000, 3)
    with pytest.raises(InputError, match="20 distinct"):
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


def test_ill_fitting_normals_are_refused() -> None:
    points, normals = sphere(100)
    with pytest.raises(InputError, match=r"\(50, 3\).*\(100, 3\)"):
        global_witness(points, normals[:50])
    with pytest.raises(InputError, match="finite"):
        global_witness(points, normals * torch.nan)


@pytest.mark.parametrize("shift", [*(pytest.param(one, marks=pytest.mark.long) for one in (1 / 12, 1 / 6)), 1 / 4])
def test_two_scans_of_one_surface_are_one_surface(shift: float) -> None:
    """The second one is moved by a part of the sample spacing, as after a registration."""
    known = torus_samples(1500, generator=torch.Generator().manual_seed(0))
    way = torch.tensor([1.0, 2.0, 2.0]).double() / 3 * (known.area / len(known.points)) ** 0.5
    report = tk.from_points(torch.cat((known.points, known.points + shift * way))).report()
    assert (report.euler, report.closed, report.verdict) == (0, True, "likely")
