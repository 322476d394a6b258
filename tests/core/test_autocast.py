"""Answers and gradients under `torch.autocast` are those without it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext

import pytest
import torch
from torch import Tensor, nn

import topokit as tk
from topokit.testing import torus_mesh, torus_samples

TORUS = torus_samples(400, generator=torch.Generator().manual_seed(0))
POINTS, NORMALS = TORUS.points.float(), TORUS.normals.float()
VERTICES, FACES = torus_mesh()
BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
AXES = torch.meshgrid(*[torch.linspace(-1, 1, 24)] * 3, indexing="ij")
GRAY = 0.25 - torch.hypot(torch.hypot(AXES[0], AXES[1]) - 0.55, AXES[2])

Answer = Callable[[Tensor], Tensor]


def autocast() -> torch.autocast:
    return torch.autocast("cpu", dtype=torch.bfloat16)


def cloud(points: Tensor) -> tk.Shape:
    return tk.from_points(points)


def oriented(points: Tensor) -> tk.Shape:
    return tk.from_points(points, NORMALS)


def mesh(vertices: Tensor) -> tk.Shape:
    return tk.from_mesh(vertices, FACES, n_samples=400)


def volume(values: Tensor) -> tk.Shape:
    return tk.from_voxels(values, level=0.0, n_samples=400)


def network(weight: Tensor) -> tk.Shape:
    def sphere(x: Tensor) -> Tensor:
        hidden = nn.functional.softplus(nn.functional.linear(x + 0.3, weight), beta=20)
        return x.norm(dim=1) - 0.6 + 0.1 * hidden.mean(1)

    return tk.from_sdf(sphere, bounds=BOX, n_samples=400, field_resolution=24)


WEIGHT = torch.randn(16, 3, generator=torch.Generator().manual_seed(1))
ANSWERS: dict[str, tuple[Answer, Tensor]] = {
    "curvature": (lambda x: cloud(x).curvature(20).gaussian.tanh().sum(), POINTS),
    "curvature of any k": (lambda x: cloud(x).curvature().mean.abs().sum(), POINTS),
    "curvature by pca": (lambda x: cloud(x).curvature(20, normal_method="pca").principal.tanh().sum(), POINTS),
    "curvature with cells by Monte Carlo": (
        lambda x: cloud(x).curvature(20, area_method="monte-carlo").area.sum(),
        POINTS,
    ),
    "gauss_bonnet": (lambda x: oriented(x).gauss_bonnet(20, boundary=False), POINTS),
    "gauss_bonnet with a boundary": (lambda x: oriented(x).gauss_bonnet(), POINTS),
    "refined euler": (lambda x: oriented(x).refined_euler(0.5, 20, boundary=False), POINTS),
    "regularized": (lambda x: oriented(x).regularized().samples.points.square().sum(), POINTS),
    "oriented": (lambda x: (cloud(x).oriented().samples.normals * POINTS).sum(), POINTS),
    "winding loss": (lambda x: tk.losses.WindingLoss(resolution=32)(x, NORMALS), POINTS),
    "winding loss of normals": (lambda x: tk.losses.WindingLoss(resolution=32)(POINTS, x), NORMALS),
    "topology loss of points": (lambda x: tk.topology_loss(oriented(x), 0, resolution=32), POINTS),
    "euler loss of points": (lambda x: tk.euler_loss(oriented(x), 2.0, 0.1, resolution=32), POINTS),
    "mesh": (lambda x: mesh(x).curvature(20).gaussian.tanh().sum(), torch.as_tensor(VERTICES).float()),
    "euler of a mesh": (lambda x: mesh(x).euler(), torch.as_tensor(VERTICES).float()),
    "volume": (lambda x: volume(x).curvature(20).gaussian.tanh().sum(), GRAY),
    "smoothed euler of a volume": (lambda x: volume(x).smoothed_euler(0.1), GRAY),
    "network": (lambda x: network(x).curvature(20).gaussian.tanh().sum(), WEIGHT),
    "smoothed euler of a network": (lambda x: network(x).smoothed_euler(0.3), WEIGHT),
    "euler loss of a network": (lambda x: tk.euler_loss(network(x), 0.0, 0.1), WEIGHT),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_answers_and_gradients_are_those_without_autocast(name: str) -> None:
    answer, given = ANSWERS[name]

    def found(context: Callable[[], object]) -> tuple[Tensor, Tensor]:
        leaf = given.clone().requires_grad_()
        with context():
            value = answer(leaf)
        (slope,) = torch.autograd.grad(value, leaf)
        return value.detach(), slope

    value, slope = found(autocast)
    expected, steep = found(nullcontext)
    assert value.dtype == expected.dtype
    torch.testing.assert_close(value, expected, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(slope, steep, rtol=1e-4, atol=1e-5 * float(steep.abs().max()))
    assert float(steep.abs().max()) > 0


def test_points_from_a_decoder_under_autocast_have_a_gradient_to_its_weights() -> None:
    """They come in half precision; they are widened, and everything behind them is in single precision."""
    decoder = nn.Linear(3, 3, bias=False)
    with torch.no_grad():
        decoder.weight.copy_(torch.eye(3))
    with autocast():
        points = decoder(POINTS)
        normals = decoder(NORMALS)
        value = tk.from_points(points, normals).curvature(20).total.tanh().sum()
    assert (points.dtype, value.dtype) == (torch.bfloat16, torch.float32)
    (slope,) = torch.autograd.grad(value, decoder.weight)
    widened = tk.from_points(points.detach().float(), normals.detach().float())
    torch.testing.assert_close(value.detach(), widened.curvature(20).total.tanh().sum())
    assert slope.isfinite().all()
    assert slope.abs().sum() > 0


def test_the_winding_loss_widens_normals_in_half_precision() -> None:
    normals = NORMALS.bfloat16().requires_grad_()
    with autocast():
        value = tk.losses.WindingLoss(resolution=32)(POINTS, normals)
    expected = tk.losses.WindingLoss(resolution=32)(POINTS, normals.detach().float())
    torch.testing.assert_close(value.detach(), expected)
    (slope,) = torch.autograd.grad(value, normals)
    assert slope.isfinite().all()
    assert slope.abs().sum() > 0


def test_a_function_may_enter_autocast_itself() -> None:
    """What it computes is its own affair; what autocast says around topokit does not reach it."""
    seen = set()
    plain = nn.Linear(3, 16)

    def mixed(x: Tensor) -> Tensor:
        seen.add((torch.is_autocast_enabled("cpu"), plain(x).dtype))
        with autocast():
            return x.norm(dim=1) - 0.6 + 0 * plain(x).float().sum(1)

    with autocast():
        samples = tk.from_sdf(mixed, bounds=BOX, n_samples=100).samples
    assert seen == {(False, torch.float32)}
    assert float((samples.points.detach().norm(dim=1) - 0.6).abs().max()) < 1e-5


def test_autocast_is_as_it_was_afterwards_also_after_an_error() -> None:
    with autocast():
        tk.from_points(POINTS).curvature(20)
        assert torch.is_autocast_enabled("cpu")
        with pytest.raises(tk.errors.InputError):
            tk.from_points(POINTS).curvature(2)
        assert torch.is_autocast_enabled("cpu")
        assert (POINTS @ POINTS.mT).dtype == torch.bfloat16
