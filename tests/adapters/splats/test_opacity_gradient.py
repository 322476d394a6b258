"""Where opacity decides the integer of splats, `euler()` has a gradient to all that a splat has, opacity included."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import trimesh
from splat_writers import torus_scene
from torch import Tensor

import topokit as tk
from topokit.adapters.splats.absorption import gaussians_of
from topokit.core.opacity.scene import AbsorbingScene
from topokit.core.samples import SurfaceSamples
from topokit.testing import genus_mesh

Parts = tuple[Tensor, Tensor, Tensor, Tensor]


def scene_of(mesh: trimesh.Trimesh, count: int, opacity: float) -> Parts:
    """Discs on a mesh, evenly spread."""
    points, face = trimesh.sample.sample_surface_even(mesh, count, seed=0)
    normals = torch.from_numpy(mesh.face_normals[face].copy())
    means = torch.from_numpy(np.asarray(points).copy())
    spacing = math.sqrt(mesh.area / len(means))
    quaternions = torch.stack((1 + normals[:, 2], -normals[:, 1], normals[:, 0], torch.zeros(len(means)).double()), 1)
    scales = torch.tensor([spacing, spacing, 0.05 * spacing], dtype=torch.float64).expand(len(means), 3)
    return means, scales, quaternions, torch.full((len(means),), opacity, dtype=torch.float64)


def with_graph(parts: Parts) -> Parts:
    a, b, c, d = (part.clone().requires_grad_() for part in parts)
    return a, b, c, d


def scene_and_shape(parts: Parts, *, coarse: int = 160) -> tuple[tk.GaussianSplats, tk.Shape]:
    """Splats of which too few are samples: the others only absorb light."""
    splats = tk.GaussianSplats(*parts)
    rows = torch.randperm(len(splats), generator=torch.Generator().manual_seed(0))[:coarse]
    samples = SurfaceSamples(splats.means[rows], oriented=False)
    return splats, tk.Shape(samples, opacity=AbsorbingScene(lambda: gaussians_of(splats)))


@pytest.fixture(scope="module")
def genus_three() -> Parts:
    return scene_of(trimesh.Trimesh(*genus_mesh(3), process=False), 3_000, 0.6)


def test_where_opacity_decides_the_gradient_is_that_of_the_optical_depth(genus_three: Parts) -> None:
    parts = with_graph(genus_three)
    splats, shape = scene_and_shape(parts)
    value = shape.euler()
    assert (float(value.detach()), shape.report().reasons[0].split(";")[0]) == (
        -4,
        "What cannot be seen into from outside has χ = -4 in all 16 readings",
    )
    found = torch.autograd.grad(value, parts, retain_graph=True)  # unit quaternions are shared
    depth = splats.optical_depth()
    field = tk.from_voxels(depth.values, level=math.log(2), spacing=depth.spacing, origin=depth.origin)
    estimate = field.smoothed_euler()
    assert float(estimate.detach()) == pytest.approx(-4, abs=0.5)
    expected = torch.autograd.grad(estimate, parts)
    for one, other in zip(found, expected, strict=True):
        assert one.isfinite().all()
        assert float(one.abs().max()) > 0
        torch.testing.assert_close(one, other)


def test_opacities_alone_have_a_gradient_there(genus_three: Parts) -> None:
    opacities = genus_three[3].clone().requires_grad_()
    value = scene_and_shape((*genus_three[:3], opacities))[1].to(torch.float32).euler()
    assert value.dtype == torch.float32
    value.backward()
    assert float(opacities.grad.abs().max()) > 0


def test_there_is_no_graph_where_none_is_asked_for(genus_three: Parts) -> None:
    assert not scene_and_shape(genus_three)[1].euler().requires_grad
    with torch.no_grad():
        assert not scene_and_shape(with_graph(genus_three))[1].euler().requires_grad


def test_where_samples_decide_the_gradient_is_that_of_curvature() -> None:
    scene = torus_scene(1_500)
    means, *others = (torch.from_numpy(np.ascontiguousarray(part)).double() for part in scene)
    means.requires_grad_()
    opacities = others[2].requires_grad_()
    shape = tk.from_splats(tk.GaussianSplats(means, *others))
    value = shape.euler()
    assert float(value.detach()) == 0
    found = torch.autograd.grad(value, (means, opacities), retain_graph=True, allow_unused=True)
    torch.testing.assert_close(found[0], torch.autograd.grad(shape.gauss_bonnet(boundary=False), means)[0])
    assert found[1] is None


def smoothed(*parts: Tensor) -> Tensor:
    splats = tk.GaussianSplats(*parts)
    value = AbsorbingScene(lambda: gaussians_of(splats)).smoothed_euler()
    assert value is not None
    return value


def test_derivatives_agree_with_differences() -> None:
    means, scales, quaternions, opacities = scene_of(trimesh.creation.torus(1.0, 0.4), 60, 0.7)
    noise = torch.randn(means.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    parts = with_graph((means + 0.02 * noise, scales * (1 + 0.1 * noise.abs()), quaternions, opacities))
    assert torch.autograd.gradcheck(smoothed, parts, eps=1e-7, atol=1e-4, rtol=1e-3, fast_mode=True)


def test_derivatives_are_finite_at_the_ends_of_all_ranges() -> None:
    means, scales, quaternions, opacities = scene_of(trimesh.creation.torus(1.0, 0.4), 400, 0.7)
    means, scales, opacities = means.clone(), scales.clone(), opacities.clone()
    means[:50] = means[50:100]  # twice in one place
    scales[100:150, 2] = 0
    scales[150:160] = 1e-12
    opacities[:50], opacities[200:250] = 0, 1
    parts = with_graph((means, scales, quaternions, opacities))
    smoothed(*parts).backward()
    assert all(bool(part.grad.isfinite().all()) for part in parts)
