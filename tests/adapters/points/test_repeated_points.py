"""Repeated points, as in merged scans and corners of triangles, count once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

import topokit as tk
from topokit.testing import as_on_accelerator, icosphere, torus_mesh, torus_samples

VERTICES, FACES = map(torch.as_tensor, torus_mesh())
POINTS = VERTICES.double()
NORMALS = torch.nn.functional.normalize(
    POINTS - torch.nn.functional.normalize(POINTS * torch.tensor([1, 1, 0]), dim=1), dim=1
)
COUNT = len(POINTS)


def moved(points: Tensor, size: float) -> Tensor:
    return points + size * torch.randn(points.shape, generator=torch.Generator().manual_seed(0), dtype=points.dtype)


REPEATED: dict[str, Callable[[], Tensor]] = {
    "twice": lambda: POINTS.repeat(2, 1),
    "twice, single precision": lambda: POINTS.repeat(2, 1).float(),
    "ten times": lambda: POINTS.repeat(10, 1),
    "twice, nearly": lambda: moved(POINTS.repeat(2, 1), 1e-9),
    "half of it eight times, nearly": lambda: moved(torch.cat((POINTS, *[POINTS[: COUNT // 2]] * 7)), 2.5e-4),
    "corners": lambda: POINTS[FACES].reshape(-1, 3),
}


@pytest.mark.parametrize("name", REPEATED)
def test_repeated_points_count_once(name: str) -> None:
    points = REPEATED[name]()
    shape = tk.from_points(points)
    report = shape.report()
    assert (report.verdict, report.euler, report.closed, report.genus) == ("likely", 0, True, 1)
    assert len(shape.samples.points) == COUNT
    assert any(f"{len(points) - COUNT} of {len(points)} points" in note for note in report.reasons)


def test_exact_copies_change_no_digit() -> None:
    points = torus_samples(1000).points
    once, thrice = tk.from_points(points), tk.from_points(points.repeat(3, 1))
    assert torch.equal(once.samples.points, thrice.samples.points)
    assert torch.equal(once.gauss_bonnet(), thrice.gauss_bonnet())
    first, second = once.report(), thrice.report()
    assert (first.verdict, first.euler, first.confidence) == (second.verdict, second.euler, second.confidence)
    assert (second.verdict, second.euler) == ("likely", 0)


def test_normals_are_averaged_up_to_sign() -> None:
    tilted = torch.nn.functional.normalize(NORMALS + 0.3 * torch.roll(NORMALS, 1, dims=1), dim=1)
    samples = tk.from_points(POINTS.repeat(2, 1), torch.cat((NORMALS, -tilted))).samples
    torch.testing.assert_close(samples.normals, (NORMALS + tilted) / 2)


def test_the_gradient_is_shared_by_the_copies() -> None:
    once, twice = POINTS.clone().requires_grad_(), POINTS.repeat(2, 1).requires_grad_()
    directions = NORMALS.clone().requires_grad_(), NORMALS.repeat(2, 1).requires_grad_()
    for points, normals in zip((once, twice), directions, strict=True):
        curvature = tk.from_points(points, normals).curvature()
        (curvature.gaussian * curvature.area).square().sum().backward()
    for whole, parts in ((once.grad, twice.grad), (directions[0].grad, directions[1].grad)):
        assert whole is not None
        assert parts is not None
        assert whole.abs().max() > 0
        torch.testing.assert_close(parts, whole.repeat(2, 1) / 2)


def test_the_mean_of_near_copies_has_the_gradient_of_a_mean() -> None:
    points = moved(POINTS.repeat(3, 1), 1e-7).requires_grad_()
    merged = tk.from_points(points).samples.points
    torch.testing.assert_close(merged, points.reshape(3, -1, 3).mean(0), rtol=0, atol=1e-14)
    weights = torch.rand(merged.shape, generator=torch.Generator().manual_seed(1), dtype=merged.dtype)
    (found,) = torch.autograd.grad((merged * weights).sum(), points)
    torch.testing.assert_close(found, weights.repeat(3, 1) / 3)


def test_what_is_not_merged() -> None:
    repeated = POINTS.repeat(2, 1)
    assert tk.from_points(repeated[None]).samples.points.shape == (1, 2 * COUNT, 3)
    with as_on_accelerator():
        assert len(tk.from_points(repeated).samples.points) == 2 * COUNT
    two_places = torch.tensor([[0.0] * 3, [1.0] * 3]).repeat(100, 1)
    assert len(tk.from_points(two_places).samples.points) == 200


def test_files_are_merged(tmp_path: Path) -> None:
    vertices, faces = icosphere(3)
    path = tmp_path / "corners.xyz"
    corners = torch.as_tensor(vertices)[torch.as_tensor(faces)].reshape(-1, 3)
    path.write_text("\n".join(" ".join(map(repr, row)) for row in corners.tolist()))
    shape = tk.load(path)
    assert len(shape.samples.points) == len(vertices)
    assert (shape.report().euler, shape.report().verdict) == (2, "likely")
