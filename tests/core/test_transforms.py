"""Curvature under torch's transforms: second derivatives, forward mode, vmap, and compilation without graph breaks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import pytest
import torch
from torch import Tensor

from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.testing import as_on_accelerator, ellipsoid_samples

Kind = Literal["given", "pca", "quadric"]
KNOWN = ellipsoid_samples(40, generator=torch.Generator().manual_seed(5))
NEIGHBORS = nearest_neighbors(KNOWN.points, 12)
DIRECTION = torch.randn(40, 3, generator=torch.Generator().manual_seed(6), dtype=torch.float64)


def value(points: Tensor, kind: Kind, neighbors: Tensor = NEIGHBORS) -> Tensor:
    """χ and the mean total curvature, from given or estimated normals."""
    samples = SurfaceSamples(points, KNOWN.normals if kind == "given" else None)
    settings = CurvatureSettings(12, normal_method="quadric" if kind == "quadric" else "pca")
    local = surface_curvature(samples, settings, neighbors=neighbors)
    return euler_characteristic(local.gaussian, local.area) + local.total.mean()


def gradient(points: Tensor, kind: Kind) -> Tensor:
    leaf = points.clone().requires_grad_() if not points.requires_grad else points
    return torch.autograd.grad(value(leaf, kind), leaf, create_graph=True)[0]


all_kinds = pytest.mark.parametrize("kind", ["given", "pca", "quadric"])


@all_kinds
def test_second_derivatives_are_those_of_finite_differences(kind: Kind) -> None:
    points, step = KNOWN.points.clone().requires_grad_(), 1e-6 * DIRECTION
    (product,) = torch.autograd.grad((gradient(points, kind) * DIRECTION).sum(), points)
    ahead, behind = (gradient(KNOWN.points + side * step, kind).detach() for side in (1, -1))
    expected = (ahead - behind) / 2e-6
    assert (product - expected).norm() < 1e-6 * expected.norm()


@all_kinds
@pytest.mark.parametrize("on_device", [True, False])
def test_forward_mode_agrees_with_the_gradient(kind: Kind, on_device: bool) -> None:
    if on_device:
        with as_on_accelerator():
            _, slope = torch.func.jvp(lambda p: value(p, kind), (KNOWN.points,), (DIRECTION,))
    else:
        with torch.autograd.forward_ad.dual_level():
            dual = torch.autograd.forward_ad.make_dual(KNOWN.points, DIRECTION)
            slope = torch.autograd.forward_ad.unpack_dual(value(dual, kind)).tangent
    torch.testing.assert_close(slope, (gradient(KNOWN.points, kind) * DIRECTION).sum().detach())


@all_kinds
def test_vmap_gives_what_a_loop_gives(kind: Kind) -> None:
    clouds = torch.stack([KNOWN.points, 1.1 * KNOWN.points, KNOWN.points.flip(-1)])
    with as_on_accelerator():
        neighbors = torch.func.vmap(lambda p: nearest_neighbors(p, 12))(clouds)
        assert torch.equal(neighbors, nearest_neighbors(clouds, 12))
        slope: Callable[[Tensor, Tensor], Tensor] = torch.func.grad(lambda p, near: value(p, kind, near))
        together = torch.func.vmap(slope)(clouds, neighbors)
        alone = [slope(points, near) for points, near in zip(clouds, neighbors, strict=True)]
    torch.testing.assert_close(together, torch.stack(alone))


@pytest.mark.parametrize(
    "kind", [*(pytest.param(kind, marks=pytest.mark.long) for kind in ("given", "pca")), "quadric"]
)
def test_compiles_without_graph_breaks(kind: Kind) -> None:
    torch.compiler.reset()
    points = KNOWN.points.clone().requires_grad_()
    compiled = torch.compile(value, fullgraph=True, backend="eager")
    result = compiled(points, kind)
    torch.testing.assert_close(result, value(points, kind))
    torch.testing.assert_close(torch.autograd.grad(result, points)[0], gradient(KNOWN.points, kind).detach())
