"""Tangent Voronoi cells against Qhull, the Monte Carlo count, and known total areas."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial import SphericalVoronoi, Voronoi
from torch.autograd import gradcheck

from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.voronoi import cell_areas, exact_cell_areas, monte_carlo_cell_areas
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.testing import AnalyticSamples, ellipsoid_samples, sphere_samples, torus_samples


def neighborhoods(n: int, k: int, generator: torch.Generator) -> torch.Tensor:
    """k nearest of 60 random points around the origin, (n, k, 2)."""
    points = torch.rand(n, 60, 2, generator=generator, dtype=torch.float64) - 0.5
    order = points.square().sum(-1).argsort(-1)[:, :k]
    return points.take_along_dim(order[..., None], dim=1)


def qhull_area(neighbors: np.ndarray) -> float:
    diagram = Voronoi(np.concatenate((np.zeros((1, 2)), neighbors)))
    corners = diagram.vertices[diagram.regions[diagram.point_region[0]]]
    turn = np.argsort(np.arctan2(*(corners - corners.mean(0)).T))
    x, y = corners[turn].T
    return 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))


def test_exact_area_is_that_of_qhull(generator: torch.Generator) -> None:
    tangent = neighborhoods(200, 24, generator)
    areas, is_open = exact_cell_areas(tangent)
    closed = (~is_open).nonzero().ravel()
    assert len(closed) > 190
    expected = [qhull_area(tangent[i].numpy()) for i in closed]
    np.testing.assert_allclose(areas[closed].numpy(), expected, rtol=1e-9)


def test_monte_carlo_agrees_within_its_sampling_error(generator: torch.Generator) -> None:
    tangent = neighborhoods(300, 20, generator)
    areas, is_open = exact_cell_areas(tangent)
    counted = monte_carlo_cell_areas(tangent, resolution=64)
    square = (2.2 * tangent.abs().amax((-2, -1))).square()
    share = areas / square
    deviation = ((counted - areas) / square / (share * (1 - share) / 64**2).sqrt())[~is_open]
    assert deviation.abs().max() < 5
    assert abs(deviation.mean()) < 0.2


@pytest.mark.parametrize("k", [8, 24])
def test_grid_cells_have_unit_area_despite_ties(k: int) -> None:
    ticks = torch.arange(-2.0, 3.0, dtype=torch.float64)
    grid = torch.cartesian_prod(ticks, ticks)
    grid = grid[grid.abs().sum(-1) > 0]
    nearest = grid[grid.square().sum(-1).argsort(stable=True)[:k]]
    area, is_open = exact_cell_areas(nearest)
    assert float(area) == pytest.approx(1.0)
    assert not bool(is_open)


def test_duplicates_and_points_at_the_centre_change_nothing(generator: torch.Generator) -> None:
    tangent = neighborhoods(50, 16, generator)
    repeated = torch.cat((tangent, tangent[:, :5], torch.zeros(50, 2, 2, dtype=torch.float64)), dim=1)
    torch.testing.assert_close(exact_cell_areas(repeated), exact_cell_areas(tangent))


def test_cells_of_half_planes_lines_and_nothing_are_open() -> None:
    half = torch.tensor([[1.0, 0.0], [1.0, 1.0], [-1.0, 0.0], [-1.0, 1.0], [0.0, 1.0]])
    area, is_open = exact_cell_areas(half)
    assert bool(is_open)
    assert float(area) == pytest.approx(0.5)  # what lies within the surface's own wedge
    for nothing in (torch.tensor([[1.0, 0.0], [2.0, 0.0], [-1.0, 0.0]]), torch.zeros(4, 2)):
        area, is_open = exact_cell_areas(nothing)
        assert bool(is_open)
        assert float(area) == 0


def clipped_cell(neighbors: np.ndarray) -> tuple[float, bool]:
    """Area and openness by clipping each bisector against all others, as `exact_cell_areas` defines them."""
    neighbors = neighbors[(neighbors**2).sum(1) > 0]
    squared = (neighbors**2).sum(1)
    area, ends_known = 0.0, []
    for own, (u, size) in enumerate(zip(neighbors, squared, strict=True)):
        others = np.delete(neighbors, own, axis=0)
        cross, rise = u[0] * others[:, 1] - u[1] * others[:, 0], (others**2).sum(1) - others @ u
        upper = (rise[cross > 0] / cross[cross > 0] / 2).min(initial=np.inf)
        lower = (rise[cross < 0] / cross[cross < 0] / 2).max(initial=-np.inf)
        if lower < upper and not ((cross == 0) & (rise < 0)).any():  # not hidden behind a nearer one
            known = [size * (0.25 + end**2) <= squared.max() for end in (lower, upper)]
            ends_known += known
            area += size * max((upper if known[1] else 0) - (lower if known[0] else 0), 0) / 4
    return area, not ends_known or not all(ends_known)


@pytest.mark.parametrize("k", [3, 6, 20])
def test_open_and_closed_cells_are_those_of_clipping(k: int, generator: torch.Generator) -> None:
    around = torch.randn(150, k, 2, generator=generator, dtype=torch.float64)
    half = torch.rand(150, k, 2, generator=generator, dtype=torch.float64) - torch.tensor([0.5, 0.1])
    tangent = torch.cat((around, half, half * (torch.rand(150, k, 1, generator=generator) < 0.7)))
    areas, is_open = exact_cell_areas(tangent)
    expected = [clipped_cell(cell.numpy()) for cell in tangent]
    np.testing.assert_allclose(areas, [area for area, _ in expected], rtol=1e-9, atol=1e-12)
    assert is_open.tolist() == [is_open for _, is_open in expected]
    assert 0 < int(is_open.sum()) <= 450


def test_area_passes_gradcheck(generator: torch.Generator) -> None:
    tangent = neighborhoods(6, 12, generator).requires_grad_()
    assert gradcheck(lambda values: exact_cell_areas(values)[0], (tangent,))


def test_area_gradient_is_finite_where_points_coincide() -> None:
    tangent = torch.tensor([[1.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]).requires_grad_()
    exact_cell_areas(tangent)[0].backward()
    assert tangent.grad is not None
    assert tangent.grad.isfinite().all()


@pytest.mark.parametrize("make", [sphere_samples, ellipsoid_samples, torus_samples])
@pytest.mark.parametrize("with_normals", [True, False])
def test_total_area_is_within_a_per_cent(make: type, with_normals: bool) -> None:
    known: AnalyticSamples = make(10_000)
    samples = SurfaceSamples(known.points, known.normals if with_normals else None)
    assert float(surface_curvature(samples).area.sum()) == pytest.approx(known.area, rel=0.01)


def test_monte_carlo_total_area_is_within_a_per_cent() -> None:
    known = sphere_samples(4000)
    local = surface_curvature(SurfaceSamples(known.points, known.normals), CurvatureSettings(area_method="monte-carlo"))
    assert float(local.area.sum()) == pytest.approx(known.area, rel=0.01)


def test_cells_on_the_sphere_are_the_spherical_ones() -> None:
    known = sphere_samples(3000)
    local = surface_curvature(SurfaceSamples(known.points, known.normals), CurvatureSettings(n_neighbors=40))
    expected = SphericalVoronoi(known.points.numpy()).calculate_areas()
    np.testing.assert_allclose(local.area.numpy(), expected, rtol=0.05)


def test_open_surfaces_keep_their_area_and_show_their_boundary() -> None:
    known = sphere_samples(20_000)
    upper = known.points[:, 2] > 0
    local = surface_curvature(SurfaceSamples(known.points[upper], known.normals[upper]))
    assert float(local.area.sum()) == pytest.approx(known.area / 2, rel=0.01)
    height = known.points[upper][:, 2]
    spacing = (known.area / 20_000) ** 0.5
    assert float(height[local.is_boundary].median()) < spacing
    assert int(local.is_boundary.sum()) > 0.3 * 2 * np.pi / spacing


def test_unknown_methods_are_refused_by_name() -> None:
    with pytest.raises(InputError, match="'fancy' is unknown; use 'exact' or 'monte-carlo'"):
        cell_areas(torch.zeros(4, 2), "fancy")  # type: ignore[arg-type]
