"""The winding-number field against direct summation, and the spline transfer that it rests on."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from topokit.core.grid import splines
from topokit.core.grid.grid import Grid, make_grid
from topokit.core.grid.splines import GridSampler
from topokit.core.grid.winding_field import PoissonFilter, regularize, winding_field
from topokit.errors import InputError
from topokit.testing import sphere_samples, torus_samples

DEVICES = ["cpu"] + (["cuda"] if torch.cuda.is_available() else [])


def sphere(n_points: int) -> tuple[Tensor, Tensor, Tensor, float]:
    known = sphere_samples(n_points)
    spacing = math.sqrt(known.area / n_points)
    return known.points, known.normals, torch.full((n_points,), known.area / n_points, dtype=torch.float64), spacing


def direct_winding_number(queries: Tensor, points: Tensor, normals: Tensor, areas: Tensor) -> Tensor:
    """The sum over all samples, (M,), at queries (M, 3) away from them."""
    parts = []
    for block in queries.split(256):
        difference = points[None] - block[:, None]
        parts.append(((difference * normals).sum(2) * areas / difference.norm(dim=2) ** 3).sum(1) / (4 * math.pi))
    return torch.cat(parts)


def small_grid() -> Grid:
    return Grid((16, 18, 16), (0.2, 0.2, 0.2), (-1.6, -1.6, -1.6))


def test_field_is_the_direct_sum(generator: torch.Generator) -> None:
    points, normals, areas, spacing = sphere(6000)
    field = winding_field(points, normals, areas, make_grid(points, spacing), 1.0)
    queries = 2.3 * torch.rand(2000, 3, generator=generator, dtype=torch.float64) - 1.15
    queries = queries[(queries.norm(dim=1) - 1).abs() > 0.15]
    difference = (field.sample(queries) - direct_winding_number(queries, points, normals, areas)).abs()
    assert difference.max() < 0.05
    assert difference.mean() < 0.02


def test_field_is_one_inside_and_zero_outside_and_falls_outward() -> None:
    known = torus_samples(5000)
    areas = torch.full((5000,), known.area / 5000, dtype=torch.float64)
    grid = make_grid(known.points, math.sqrt(known.area / 5000))
    field = winding_field(known.points, known.normals, areas, grid)
    assert float(field.sample(known.points).mean()) == pytest.approx(0.5, abs=1e-9)
    deep, beyond = known.points - 0.2 * known.normals, known.points + 0.2 * known.normals
    assert field.sample(deep).min() > 0.8
    assert field.sample(beyond).max() < 0.2
    assert ((field.gradient(known.points) * known.normals).sum(1) < 0).all()


def test_direct_sum_of_a_sphere_is_one_inside_and_zero_outside() -> None:
    points, normals, areas, _ = sphere(20_000)
    queries = torch.tensor([[0.0, 0, 0], [0.3, -0.2, 0.1], [2, 0, 0], [0, -3, 1]], dtype=torch.float64)
    found = direct_winding_number(queries, points, normals, areas)
    assert found.tolist() == pytest.approx([1, 1, 0, 0], abs=0.02)


def test_gathering_is_the_adjoint_of_splatting(generator: torch.Generator) -> None:
    grid = small_grid()
    points = 2 * torch.rand(50, 3, generator=generator, dtype=torch.float64) - 1
    field = torch.randn(grid.shape, generator=generator, dtype=torch.float64)
    values = torch.randn(50, 3, generator=generator, dtype=torch.float64)
    sampler = GridSampler(points, grid)
    torch.testing.assert_close((sampler.splat(values[:, 0]) * field).sum(), values[:, 0] @ sampler.gather(field))
    left = (sampler.splat_dipoles(values) * field).sum()
    torch.testing.assert_close(left, (values * sampler.gather_gradient(field)).sum())


def test_splines_reproduce_linear_fields(generator: torch.Generator) -> None:
    grid = small_grid()
    points = 2 * torch.rand(50, 3, generator=generator, dtype=torch.float64) - 1
    slope = torch.tensor([0.3, -2.0, 1.1], dtype=torch.float64)
    field = (grid.positions(torch.arange(grid.n_vertices)) @ slope + 5).reshape(grid.shape)
    torch.testing.assert_close(GridSampler(points, grid).gather(field), points @ slope + 5)
    torch.testing.assert_close(GridSampler(points, grid).gather_gradient(field), slope.expand(50, 3))


def test_blocks_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    points, normals, areas, _ = sphere(500)
    whole = winding_field(points, normals, areas, small_grid())
    monkeypatch.setattr(splines, "_BLOCK", 37)
    blocked = winding_field(points, normals, areas, small_grid())
    torch.testing.assert_close(blocked.values, whole.values)
    torch.testing.assert_close(blocked.gradient(points), whole.gradient(points))


@pytest.mark.parametrize("block", [1 << 16, 3])
def test_field_passes_gradcheck(monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    monkeypatch.setattr(splines, "_BLOCK", block)
    points, normals, areas, _ = sphere(8)
    queries = torch.tensor([[0.13, 0.2, 0.31], [1.03, -0.2, 0.4], [-0.55, 0.93, 0.17]], dtype=torch.float64)
    inputs = tuple(values.clone().requires_grad_() for values in (points, normals, areas, queries))
    assert gradcheck(lambda p, n, a, q: winding_field(p, n, a, small_grid(), 1.2).sample(q), inputs)
    assert gradcheck(lambda p, n, a, q: winding_field(p, n, a, small_grid(), 1.2).gradient(q), inputs)


def test_poisson_filter_divides_waves_by_their_squared_wavenumber() -> None:
    cell, n = 0.5, 16
    steps = torch.arange(n, dtype=torch.float64)
    wave = (2 * math.pi * 3 * steps / n).cos()[:, None, None] * (2 * math.pi * steps / n).sin()[None, :, None]
    density = (wave * torch.ones(n)).contiguous()
    squared = (2 * math.pi / n) ** 2 * (3**2 + 1)  # per cell²
    solver = PoissonFilter(Grid((n, n, n), (cell, cell, cell)), 0.0, density)
    for sigma in (0.0, 1.5, 0.7):
        solver.smooth(sigma)
        expected = density * math.exp(-(sigma**2) * squared / 2) / squared / cell
        torch.testing.assert_close(solver(density + 7.0), expected, atol=1e-12, rtol=0)


def test_regularize_passes_gradcheck() -> None:
    inputs = tuple(values.clone().requires_grad_() for values in sphere(8)[:3])
    assert gradcheck(lambda p, n, a: regularize(p, n, a, small_grid(), 2.0, steps=1), inputs)


def test_regularize_removes_noise(generator: torch.Generator) -> None:
    points, normals, areas, spacing = sphere(6000)
    noisy = points + 0.01 * torch.randn(points.shape, generator=generator, dtype=torch.float64)
    wrong = torch.nn.functional.normalize(
        normals + 0.2 * torch.randn(points.shape, generator=generator).double(), dim=1
    )
    grid = make_grid(noisy, spacing)
    moved, better = regularize(noisy, wrong, areas, grid, 2.0)
    field = winding_field(noisy, wrong, areas, grid, 2.0)
    assert (field.sample(moved) - 0.5).abs().mean() < 0.1 * (field.sample(noisy) - 0.5).abs().mean()
    assert moved.norm(dim=1).std() < 0.5 * noisy.norm(dim=1).std()
    exact = moved / moved.norm(dim=1, keepdim=True)
    assert (1 - (better * exact).sum(1)).mean() < 0.25 * (1 - (wrong * normals).sum(1)).mean()
    torch.testing.assert_close(better.norm(dim=1), torch.ones_like(areas))


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtype_and_device_are_kept(dtype: torch.dtype, device: str) -> None:
    points, normals, areas, _ = (v.to(device, dtype) if isinstance(v, Tensor) else v for v in sphere(2000))
    field = winding_field(points, normals, areas, make_grid(points, 0.08))
    reference = winding_field(*sphere(2000)[:3], make_grid(sphere(2000)[0], 0.08))
    assert field.values.dtype == dtype
    assert field.values.device.type == device
    torch.testing.assert_close(field.values.cpu().double(), reference.values, atol=1e-4, rtol=0)
    assert all(one.dtype == dtype for one in regularize(points, normals, areas, field.grid))


def test_unusable_input_is_refused() -> None:
    points, normals, areas, _ = sphere(10)
    with pytest.raises(InputError, match=r"areas \(N,\)"):
        winding_field(points, normals, areas[:5], small_grid())
    with pytest.raises(InputError, match="must be cubes"):
        winding_field(points, normals, areas, Grid((16, 16, 16), (0.2, 0.2, 0.3), (-1.6, -1.6, -1.6)))
