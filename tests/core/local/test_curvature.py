"""Curvatures against analytic surfaces: values, signs, and the order at which errors fall."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from topokit.core.local.curvature import Curvature, CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_by_component, euler_characteristic
from topokit.core.neighbors import neighbor_components
from topokit.core.samples import SurfaceSamples
from topokit.testing import AnalyticSamples, ellipsoid_samples, sphere_samples, torus_samples

PAPER = CurvatureSettings(normal_method="pca")
MAKERS = [sphere_samples, ellipsoid_samples, torus_samples]


def measure(known: AnalyticSamples, with_normals: bool = True, **options: object) -> Curvature:
    samples = SurfaceSamples(known.points, known.normals if with_normals else None)
    return surface_curvature(samples, CurvatureSettings(**options))  # type: ignore[arg-type]


def fibonacci_sphere(n: int) -> Tensor:
    index = torch.arange(n, dtype=torch.float64) + 0.5
    z, turn = 1 - 2 * index / n, math.pi * (1 + 5**0.5) * index
    ring = (1 - z.square()).sqrt()
    return torch.stack((ring * turn.cos(), ring * turn.sin(), z), dim=1)


def slope(sizes: list[int], errors: list[float]) -> float:
    """Exponent p of error ∝ hᵖ, with h ∝ N^(−1/2)."""
    return float(np.polyfit(np.log(np.array(sizes) ** -0.5), np.log(errors), 1)[0])


@pytest.mark.parametrize("radius", [0.25, 3.0])
def test_sphere_with_exact_normals_is_exact(radius: float) -> None:
    known = sphere_samples(2000, radius)
    local = measure(known)
    for found, expected in ((local.gaussian, known.gaussian), (local.mean, known.mean)):
        torch.testing.assert_close(found, expected, rtol=1e-9, atol=0)
    torch.testing.assert_close(local.total, 2 * known.mean.square(), rtol=1e-9, atol=0)


@pytest.mark.parametrize("make", [ellipsoid_samples, torus_samples])
@pytest.mark.parametrize("solver", ["sylvester", "symmetrized"])
def test_error_with_exact_normals_falls_with_first_order(make: type, solver: str) -> None:
    """Random neighborhoods are lopsided, so what the linear fit leaves out enters with h, not h²."""
    sizes, gaussian, mean = [1000, 4000, 16_000], [], []
    for n in sizes:
        known = make(n)
        local = measure(known, solver=solver)
        gaussian.append(float((local.gaussian - known.gaussian).abs().median()))
        mean.append(float((local.mean - known.mean).abs().median()))
    assert 0.8 < slope(sizes, gaussian) < 1.5
    assert 0.8 < slope(sizes, mean) < 1.5
    assert gaussian[-1] < 0.03 * float(known.gaussian.abs().median())


def test_error_of_pca_on_an_even_sphere_falls_with_first_order() -> None:
    sizes, errors = [1000, 4000, 16_000], []
    for n in sizes:
        local = surface_curvature(SurfaceSamples(fibonacci_sphere(n)), PAPER)
        errors.append(float((local.gaussian - 1).abs().median()))
    assert 0.8 < slope(sizes, errors) < 1.5
    assert errors[-1] < 5e-3


def test_error_of_pca_on_random_samples_falls_when_k_grows() -> None:
    """At fixed k the PCA normals err in proportion to h, and their differences over h by a constant share."""
    sizes, fixed, growing = [1000, 4000, 16_000], [], []
    for n, k in zip(sizes, (20, 40, 80), strict=True):
        known = torus_samples(n)
        for errors, neighbors in ((fixed, 20), (growing, k)):
            local = measure(known, with_normals=False, n_neighbors=neighbors, normal_method="pca")
            errors.append(float((local.gaussian - known.gaussian).abs().median()))
    assert abs(slope(sizes, fixed)) < 0.5
    assert slope(sizes, growing) > 0.5


@pytest.mark.parametrize("make", MAKERS)
def test_euler_with_exact_normals_approaches_the_integer(make: type) -> None:
    errors = []
    for n in (2000, 32_000):
        known = make(n)
        local = measure(known)
        errors.append(abs(float(euler_characteristic(local.gaussian, local.area)) - known.euler))
    assert errors[1] < 0.02
    assert errors[1] < errors[0] or errors[0] < 1e-3


@pytest.mark.parametrize("make", MAKERS)
def test_without_normals_the_euler_estimate_still_rounds_right(make: type) -> None:
    known = make(10_000)
    local = measure(known, with_normals=False)
    assert abs(float(euler_characteristic(local.gaussian, local.area)) - known.euler) < 0.5


def test_mean_curvature_is_positive_towards_the_inside_and_changes_sign_with_the_normals() -> None:
    known = torus_samples(4000)
    outward = measure(known)
    inward = surface_curvature(SurfaceSamples(known.points, -known.normals))
    assert (outward.mean[known.mean > 0.5] > 0).all()
    torch.testing.assert_close(inward.mean, -outward.mean)
    torch.testing.assert_close(inward.gaussian, outward.gaussian)


def test_principal_curvatures_and_directions_of_a_torus() -> None:
    known = torus_samples(20_000, major=1.0, minor=0.4)
    local = measure(known)
    torch.testing.assert_close(local.principal.prod(-1), local.gaussian)
    torch.testing.assert_close(local.principal.mean(-1), local.mean)
    torch.testing.assert_close(local.principal.square().sum(-1), local.total)
    assert float((local.principal[:, 1] - 1 / 0.4).abs().median()) < 0.02 / 0.4
    around = torch.stack((-known.points[:, 1], known.points[:, 0], torch.zeros(20_000)), dim=-1)
    around = around / around.norm(dim=-1, keepdim=True)
    along_smaller = (local.directions[:, 0] * around).sum(-1).abs()
    assert float(along_smaller.median()) > 0.99
    norms = local.directions.norm(dim=-1)
    torch.testing.assert_close(norms, torch.ones_like(norms))


def test_normals_of_pca_are_those_of_open3d() -> None:
    open3d = pytest.importorskip("open3d", reason="open3d is the oracle here")
    known = ellipsoid_samples(3000)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(known.points.numpy()))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(21))
    ours = measure(known, with_normals=False, normal_method="pca").normals
    theirs = torch.from_numpy(np.asarray(cloud.normals).copy())
    # open3d counts the point itself among its neighbors: the same up to that.
    assert float((ours * theirs).sum(-1).abs().quantile(0.01)) > 0.999


def test_batches_equal_their_items_and_chunks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    items = [torus_samples(600).points, sphere_samples(600).points]
    single = [surface_curvature(SurfaceSamples(points)) for points in items]
    monkeypatch.setattr("topokit.core.local.chunks.in_chunks.__defaults__", (170,))
    batch = surface_curvature(SurfaceSamples(torch.stack(items)[None]))
    assert batch.gaussian.shape == (1, 2, 600)
    assert batch.directions.shape == (1, 2, 600, 2, 3)
    for index, one in enumerate(single):
        torch.testing.assert_close(batch.gaussian[0, index], one.gaussian)
        torch.testing.assert_close(batch.area[0, index], one.area)


def test_own_frames_and_areas_are_used(generator: torch.Generator) -> None:
    known = torus_samples(2000)
    reference = measure(known)
    angle = 6.28 * torch.rand(2000, 1, generator=generator, dtype=torch.float64)
    helper = torch.randn(2000, 3, generator=generator, dtype=torch.float64)
    first = torch.linalg.cross(known.normals, helper, dim=-1)
    first = first / first.norm(dim=-1, keepdim=True)
    second = torch.linalg.cross(known.normals, first, dim=-1)
    turned = angle.cos() * first + angle.sin() * second
    frames = torch.stack((turned, torch.linalg.cross(known.normals, turned, dim=-1), known.normals), dim=-2)
    areas = torch.full((2000,), known.area / 2000, dtype=torch.float64)
    local = surface_curvature(SurfaceSamples(known.points, frames=frames, areas=areas))
    torch.testing.assert_close(local.gaussian, reference.gaussian)
    assert local.area is areas


def test_components_add_up() -> None:
    torus, sphere = torus_samples(3000), sphere_samples(2000)
    points = torch.cat((torus.points, sphere.points + 5))
    normals = torch.cat((torus.normals, sphere.normals))
    local = surface_curvature(SurfaceSamples(points, normals))
    labels = neighbor_components(local.neighbors)
    assert labels.unique().tolist() == [0, 1]
    assert (labels[:3000] == 0).all()
    parts = euler_by_component(local.gaussian, local.area, labels)
    torch.testing.assert_close(parts.sum(), euler_characteristic(local.gaussian, local.area))
    assert parts.round().tolist() == [0, 2]


@pytest.mark.parametrize(("method", "limit"), [("pca", 1e-5), ("quadric", 1e-3)])
def test_float32_gives_what_float64_gives(method: str, limit: float) -> None:
    known = torus_samples(3000)
    double = measure(known, with_normals=False, normal_method=method)
    settings = CurvatureSettings(normal_method=method)  # type: ignore[arg-type]
    single = surface_curvature(SurfaceSamples(known.points.float()), settings)
    assert single.gaussian.dtype == torch.float32
    assert float((single.gaussian - double.gaussian).abs().median()) < limit


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cuda_gives_what_the_cpu_gives() -> None:
    known = torus_samples(5000)
    here = surface_curvature(SurfaceSamples(known.points, known.normals))
    there = surface_curvature(SurfaceSamples(known.points.cuda(), known.normals.cuda()))
    assert there.gaussian.is_cuda
    torch.testing.assert_close(there.gaussian.cpu(), here.gaussian)
