"""The automatic number of neighbors: 20 on clean samples, more with noise, whatever the scale; and quadric normals."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

import topokit as tk
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.neighborhood_size import automatic_neighbors
from topokit.core.local.quadric import fit_quadrics
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.testing import AnalyticSamples, ellipsoid_samples, plate_samples, sphere_samples, torus_samples

MAKERS = [sphere_samples, ellipsoid_samples, torus_samples]


def noisy(known: AnalyticSamples, share: float) -> Tensor:
    """The points with noise of a share of the longest side."""
    side = (known.points.amax(0) - known.points.amin(0)).max()
    generator = torch.Generator().manual_seed(1)
    return known.points + share * side * torch.randn(known.points.shape, generator=generator, dtype=torch.float64)


def chosen(points: Tensor) -> int:
    return automatic_neighbors(points, nearest_neighbors(points, 20))


def error(known: AnalyticSamples, points: Tensor, **options: object) -> float:
    """Median error of K as a share of the median |K|."""
    found = tk.from_points(points).curvature(**options).gaussian  # type: ignore[arg-type]
    return float((found - known.gaussian).abs().median() / known.gaussian.abs().median())


def box(n_points: int, sides: tuple[float, float, float]) -> Tensor:
    """Random points of a box with sharp edges."""
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(n_points, 3, generator=generator, dtype=torch.float64)
    lengths = points.new_tensor(sides)
    weights = lengths.prod() / lengths  # area of the faces across each axis
    axis = torch.multinomial(weights, n_points, replacement=True, generator=generator)
    points[torch.arange(n_points), axis] = points[torch.arange(n_points), axis].round()
    return points * lengths


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("n_points", [500, 3000])
def test_clean_curved_samples_take_twenty(make: type, n_points: int) -> None:
    assert chosen(make(n_points).points) == 20


def test_sharp_edges_planes_and_thin_plates_take_twenty() -> None:
    assert chosen(box(3000, (1.0, 1.0, 1.0))) == 20
    assert chosen(plate_samples(3000).points) == 20
    plate = torch.cat((plate_samples(1500).points, plate_samples(1500).points.roll(1, 0) + torch.tensor([0, 0, 0.02])))
    assert chosen(plate) == 20  # two sheets, half a spacing apart: not noise


@pytest.mark.parametrize("make", MAKERS)
def test_noise_asks_for_more_at_any_scale_and_on_any_device_type(make: type) -> None:
    known = make(4000)
    sizes = [chosen(noisy(known, share)) for share in (0.0, 0.0025, 0.005, 0.01)]
    assert sizes == sorted(sizes)
    assert sizes[0] == 20 < sizes[1] < sizes[-1]
    points = noisy(known, 0.01)
    assert chosen(1e-6 * points + 1e-3) == chosen(1e6 * points) == sizes[-1]
    assert abs(chosen(points.float()) - sizes[-1]) <= 0.5 * sizes[-1]


@pytest.mark.parametrize(
    "make", [pytest.param(make, marks=pytest.mark.long if make is not torus_samples else ()) for make in MAKERS]
)
def test_defaults_bear_one_percent_of_noise(make: type) -> None:
    known = make(10_000)
    points = noisy(known, 0.01)
    assert error(known, points) < 0.15
    assert error(known, points, n_neighbors=20) > 0.9


@pytest.mark.parametrize("make", MAKERS)
def test_on_clean_samples_the_defaults_beat_pca(make: type) -> None:
    known = make(4000)
    assert error(known, known.points) < 0.5 * error(known, known.points, n_neighbors=20, normal_method="pca")


def test_batches_choose_one_number_and_explicit_numbers_are_obeyed() -> None:
    points = noisy(torus_samples(2000), 0.01)
    batch = tk.from_points(torch.stack((points, points)))
    both = batch.curvature()
    size = both.neighbors.shape[-1]
    assert size > 20
    torch.testing.assert_close(both.gaussian[1], tk.from_points(points).curvature(size).gaussian)
    assert tk.from_points(points, n_neighbors=25).curvature().neighbors.shape[-1] == 25
    assert tk.from_points(points).curvature(25).neighbors.shape[-1] == 25


def test_an_in_place_change_is_noticed() -> None:
    known = torus_samples(2000)
    points = known.points.clone()
    shape = tk.from_points(points)
    assert shape.curvature().neighbors.shape[-1] == 20
    points.copy_(noisy(known, 0.01))
    assert shape.curvature().neighbors.shape[-1] > 20


@pytest.mark.parametrize("points", [torch.ones(60, 3), torch.rand(21, 3), torch.linspace(0, 1, 180).reshape(60, 3)])
def test_degenerate_points_take_twenty(points: Tensor) -> None:
    assert chosen(points.double()) == 20


def test_quadric_normals_are_exact_on_a_sphere_and_differentiable() -> None:
    known = sphere_samples(3000)
    index = nearest_neighbors(known.points, 20)
    normals = fit_quadrics(known.points[index] - known.points[:, None]).normals()
    assert float((normals * known.normals).sum(-1).abs().acos().median()) < 2e-3
    points = ellipsoid_samples(16, generator=torch.Generator().manual_seed(0)).points.requires_grad_()
    settings = CurvatureSettings(n_neighbors=12, normal_method="quadric")

    def quantities(p: Tensor) -> Tensor:
        local = surface_curvature(SurfaceSamples(p), settings)
        return torch.cat((local.gaussian, local.area, local.total))

    assert gradcheck(quantities, (points,), atol=1e-3, rtol=1e-3)


def test_unknown_normal_methods_are_refused() -> None:
    with pytest.raises(tk.InputError, match="normal method 'jet' is unknown"):
        CurvatureSettings(normal_method="jet")  # type: ignore[arg-type]
