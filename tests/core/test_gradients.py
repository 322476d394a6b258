"""Differentiability is a promise: gradcheck of the whole pipeline, and finite gradients at degenerate input."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from topokit.core.local.curvature import Curvature, CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_by_component, euler_characteristic
from topokit.core.neighbors import neighbor_components
from topokit.core.samples import SurfaceSamples
from topokit.testing import ellipsoid_samples, sphere_samples, torus_samples

QUANTITIES: tuple[Callable[[Curvature], Tensor], ...] = (
    lambda local: local.area,
    lambda local: local.gaussian,
    lambda local: local.mean,
    lambda local: local.total,
    lambda local: local.principal,
    lambda local: euler_characteristic(local.gaussian, local.area),
    lambda local: euler_by_component(local.gaussian, local.area, neighbor_components(local.neighbors)),
)


def curvature(points: Tensor, normals: Tensor | None = None) -> Curvature:
    return surface_curvature(SurfaceSamples(points, normals), CurvatureSettings(n_neighbors=12))


def quantities(points: Tensor, normals: Tensor | None = None) -> tuple[Tensor, ...]:
    """All of them, so that one difference of the pipeline serves each."""
    local = curvature(points, normals)
    return tuple(quantity(local) for quantity in QUANTITIES)


@pytest.mark.parametrize("with_normals", [True, False])
def test_gradcheck_in_points_and_normals(with_normals: bool, generator: torch.Generator) -> None:
    """In general position no neighbor changes within gradcheck's step of 1e-6, so there is no jump to step over."""
    known = ellipsoid_samples(18, generator=generator)
    leaves = [known.points.clone().requires_grad_()]
    if with_normals:
        leaves.append((known.normals * 1.3).requires_grad_())
    assert gradcheck(quantities, leaves, atol=1e-4, rtol=1e-4)


def test_checkpointed_chunks_have_the_same_gradient(monkeypatch: pytest.MonkeyPatch) -> None:
    gradients = []
    for chunk in (4096, 70):
        monkeypatch.setattr("topokit.core.local.chunks.in_chunks.__defaults__", (chunk,))
        points = torus_samples(300).points.clone().requires_grad_()
        local = curvature(points)
        euler_characteristic(local.gaussian, local.area).backward()
        gradients.append(points.grad)
    torch.testing.assert_close(gradients[0], gradients[1])


def degenerate() -> dict[str, Tensor]:
    random = torch.Generator().manual_seed(3)
    ticks = torch.arange(8, dtype=torch.float64)
    plane = torch.cat((torch.rand(60, 2, generator=random, dtype=torch.float64), torch.zeros(60, 1)), dim=1).double()
    grid = torch.cat((torch.cartesian_prod(ticks, ticks), torch.zeros(64, 1)), dim=1).double()
    sphere = sphere_samples(100).points
    line = torch.linspace(0, 1, 50, dtype=torch.float64)[:, None] * torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    return {
        "plane": plane,
        "grid": grid,
        "cubic lattice": torch.cartesian_prod(ticks[:4], ticks[:4], ticks[:4]),
        "sphere": sphere,
        "duplicates": torch.cat((sphere, sphere[:40], sphere[:40])),
        "all equal": torch.ones(30, 3, dtype=torch.float64),
        "line": line,
        "thirty points": torch.randn(30, 3, generator=random, dtype=torch.float64),
        "tiny": sphere * 1e-150,
        "huge": sphere * 1e100,
    }


@pytest.mark.parametrize("name", degenerate())
@pytest.mark.parametrize("with_normals", [True, False])
def test_values_and_gradients_are_finite_at_degenerate_input(name: str, with_normals: bool) -> None:
    points = degenerate()[name].requires_grad_()
    normals = None
    if with_normals:
        normals = torch.ones_like(points).requires_grad_()
    local = curvature(points, normals)
    euler = euler_characteristic(local.gaussian, local.area)
    scale = points.detach().abs().max()
    parts = (euler, (local.area / scale**2).sum(), (local.mean * scale).sum(), (local.principal * scale).sum())
    sum(parts, local.directions.sum()).backward()
    assert all(bool(part.isfinite()) for part in parts)
    assert points.grad is not None
    assert points.grad.isfinite().all()
    if normals is not None:
        assert normals.grad is not None
        assert normals.grad.isfinite().all()


@pytest.mark.parametrize("name", sorted(degenerate().keys() - {"tiny", "huge"}))  # those leave the range of float32
def test_float32_stays_finite_too(name: str) -> None:
    points = degenerate()[name].float().requires_grad_()
    local = curvature(points)
    euler_characteristic(local.gaussian, local.area).backward()
    assert local.gaussian.isfinite().all()
    assert points.grad is not None
    assert points.grad.isfinite().all()
