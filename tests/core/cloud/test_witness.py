"""The global witness: right integers with "likely", and "unsure" or an error where it cannot know."""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch
from torch import Tensor

from topokit.core.cloud import downsampling as thinning
from topokit.core.cloud import witness
from topokit.core.cloud.votes import decide
from topokit.core.cloud.witness import global_witness
from topokit.core.mesh.sampling import sample_triangles
from topokit.errors import InputError
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
    assert (found.euler, found.verdict) == (euler, "likely"), found.reasons
    assert (found.components, found.cavities) == parts
    assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.99
    assert set(found.votes.values()) == {euler}
    assert 2.5 * found.spacing <= found.resolution < 5 * found.spacing


def test_reasons_are_sentences_with_numbers() -> None:
    found = global_witness(sphere(1500)[0])
    assert len(found.reasons) > 5
    for reason in found.reasons:
        assert reason[0].isupper() or reason[0].isdigit()
        assert reason.endswith(".")
        assert re.search(r"\d", reason)
        assert not re.search(r"sigma|alternation|setting|cut \d|grid \d|_", reason), reason


def test_flipped_normals_are_noticed_and_turned() -> None:
    points, normals = torus()
    found = global_witness(points, -3 * normals)
    assert (found.euler, found.verdict) == (0, "likely")
    assert "all point inward" in found.reasons[0]
    np.testing.assert_allclose(found.normals, normals.numpy(), atol=1e-12)


def test_partly_flipped_normals_are_noticed() -> None:
    points, normals = sphere()
    flipped = torch.where(points[:, :1] > 0.5, -normals, normals)
    found = global_witness(points, flipped)
    assert found.verdict == "unsure"
    assert "contradict" in found.reasons[0]


def test_neither_offset_nor_unit_matters() -> None:
    points, normals = torus()
    plain = global_witness(points, normals)
    for scale, shift in ((1.0, 1e6), (1e-6, 0.0), (1e7, 0.0)):
        moved = global_witness(points * scale + shift, normals)
        assert (moved.euler, moved.verdict) == (plain.euler, plain.verdict)
        assert moved.spacing == pytest.approx(scale * plain.spacing, rel=1e-4)
        assert moved.votes == plain.votes


def test_given_areas_are_used() -> None:
    known = sphere_samples(3000, radius=50.0)
    areas = torch.full((3000,), known.area / 3000)
    found = global_witness(known.points.float(), known.normals.float(), areas)
    assert (found.euler, found.verdict) == (2, "likely")
    assert found.spacing == pytest.approx((known.area / 3000) ** 0.5, rel=1e-5)


def test_a_thin_sheet_is_unsure() -> None:
    points, normals = sphere()
    flat = points * torch.tensor([1.0, 1.0, 0.02])  # thinner than the spacing of about 0.06
    bent = torch.nn.functional.normalize(normals / torch.tensor([1.0, 1.0, 0.02]), dim=1)
    for given in (bent, None):
        found = global_witness(flat, given)
        assert found.verdict == "unsure"
        assert any("walls or gaps are thinner" in reason for reason in found.reasons)


def test_noise_without_a_surface_is_unsure(generator: torch.Generator) -> None:
    found = global_witness(torch.randn(1500, 3, generator=generator))
    assert found.verdict == "unsure"
    assert any(reason.startswith("Only") for reason in found.reasons)


def test_open_half_sphere_of_few_points_does_not_fail() -> None:
    points, normals = sphere(1000)
    upper = points[:, 2] > 0
    assert isinstance(global_witness(points[upper], normals[upper]).euler, int)


def test_the_answer_is_deterministic() -> None:
    points, _ = torus(1500)
    first, second = global_witness(points), global_witness(points.clone())
    assert (first.votes, first.numbers, first.reasons) == (second.votes, second.numbers, second.reasons)
    np.testing.assert_array_equal(first.normals, second.normals)


def test_large_clouds_are_thinned_and_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (thinning, witness):
        monkeypatch.setattr(module, "MOST_POINTS", 5000)
    monkeypatch.setattr(thinning, "KEPT_POINTS", 3000)
    points, normals = torus(8000)
    for given in (normals, None, -normals):
        found = global_witness(points, given)
        assert (found.euler, found.verdict) == (0, "likely")
        assert found.reasons[0].startswith("Of 8000 points ")
        assert ((torch.from_numpy(found.normals) * normals).sum(1) > 0).double().mean() > 0.99


def test_repeated_points_are_left_out_and_that_is_said() -> None:
    points, normals = sphere(1500)
    found = global_witness(points.repeat(4, 1), normals.repeat(4, 1))
    assert (found.euler, found.verdict) == (2, "likely")
    assert found.reasons[0] == "4500 points lie where others do and were left out."
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


CUTS = ("cut 0", "cut 1", "cut 2", "smooth cut 0", "smooth cut 1")
AGREED = {f"{name} {side}": 2 for name in CUTS for side in ("inside", "outside")} | {f"grid {k}": 2 for k in range(3)}
GOOD = {"crowded": 0.0, "crowded 2.5": 0.0, "coverage": 1.0, "disagreement": 0.0}


@pytest.mark.parametrize(
    ("votes", "numbers"),
    [
        ({"grid 0": 0, "grid 1": 0}, {}),
        ({"smooth cut 0 inside": 4}, {}),
        ({name: 0 for name in AGREED if name.startswith("cut")}, {}),
        ({}, {"crowded": 0.01}),
        ({}, {"crowded 2.5": 0.02}),
        ({}, {"coverage": 0.5}),
        ({}, {"disagreement": 0.07}),
        ({}, {"given normals": 0.8}),
    ],
)
def test_one_failed_condition_is_enough_to_be_unsure(votes: dict[str, int], numbers: dict[str, float]) -> None:
    assert decide(AGREED, GOOD)[:2] == (2, "likely")
    assert decide(AGREED | votes, GOOD | numbers)[1] == "unsure"
