"""Clouds cut out of closed surfaces are open, whatever the form of their rims; closed ones stay likely."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.errors import InputError
from topokit.testing import AnalyticSamples, sphere_samples, torus_samples


def bitten_torus(n_points: int = 1500) -> tuple[torch.Tensor, torch.Tensor]:
    """A torus beyond a tangent plane of its inner equator: the rim is a figure eight."""
    known = torus_samples(n_points)
    kept = known.points[:, 0] < 0.6
    return known.points[kept], known.normals[kept]


@pytest.mark.parametrize("with_normals", [True, False])
def test_a_cloud_cut_by_a_plane_is_open(with_normals: bool) -> None:
    points, normals = bitten_torus()
    shape = tk.from_points(points, normals if with_normals else None)
    report = shape.report()
    assert (report.closed, report.verdict, report.cavities) == (False, "unsure", None)
    assert report.boundary_loops != 0
    [where] = [reason for reason in report.reasons[: report.n_deciding] if "without samples" in reason]
    low, high = (
        [float(value) for value in corner.split(")")[0].split(",")]
        for corner in where.split("between (")[1].split("and (")
    )
    assert 0.3 < low[0] <= high[0] <= 0.6  # beside the cutting plane
    with pytest.raises(InputError, match="no closed surface"):
        _ = shape.volume


def test_what_is_cut_off_must_be_larger_than_gaps_between_samples() -> None:
    known = sphere_samples(1000, generator=torch.Generator().manual_seed(0))
    spacing = (4 * torch.pi / 1000) ** 0.5
    north = torch.tensor([0.0, 0, 1], dtype=torch.float64)
    for radius, closed, verdict in ((1.5, True, "likely"), (4.0, False, "likely"), (5.0, False, "likely")):
        points = known.points[(known.points - north).norm(dim=1) > radius * spacing]
        report = tk.from_points(points).report()  # a gap of three spacings is one among random samples
        assert (report.closed, report.verdict) == (closed, verdict)


@pytest.mark.parametrize("with_normals", [True, False])
def test_a_torus_on_a_table_has_a_ring_under_it(with_normals: bool) -> None:
    known = torus_samples(2000)
    kept = known.points[:, 2] > -0.25  # the tube has radius 0.4
    shape = tk.from_points(known.points[kept], known.normals[kept] if with_normals else None)
    report = shape.report()
    assert (report.euler, report.components, report.boundary_loops, report.closed) == (0, 1, 2, False)
    assert (report.genus, report.verdict) == (1, "unsure")  # an annulus if its rims are closed by discs
    assert any("under a ring" in reason for reason in report.reasons[: report.n_deciding])
    assert shape.genus() == 1
    with pytest.raises(tk.GenusError):
        shape.genus(cap=False)
    surface = shape.surface()
    assert (surface.euler_number, surface.is_watertight) == (0, False)
    assert float(surface.vertices[:, 2].min()) > -0.26  # without its caps


def test_half_a_torus_has_two_round_ends() -> None:
    known = torus_samples(1500, generator=torch.Generator().manual_seed(1))
    report = tk.from_points(known.points[known.points[:, 0] < 0]).report()
    assert (report.euler, report.boundary_loops, report.genus, report.verdict) == (0, 2, 0, "likely")
    assert max(report.rim_widths) == pytest.approx(0.8, abs=0.1)
    assert any("planes of its holes" in reason for reason in report.reasons)


def test_a_noisy_bowl_is_open_but_may_be_a_thin_wall() -> None:
    rng = np.random.default_rng(0)
    bowl = rng.normal(size=(3000, 3))
    bowl /= np.linalg.norm(bowl, axis=1)[:, None]
    bowl = bowl[bowl[:, 2] < 0]
    report = tk.from_points(torch.from_numpy(bowl + 0.06 * rng.normal(size=bowl.shape))).report()
    assert (report.euler, report.closed, report.verdict) == (1, False, "unsure")
    assert any("noise" in reason for reason in report.reasons[:3])
    assert tk.from_points(torch.from_numpy(bowl)).report().verdict == "likely"


@pytest.mark.parametrize(("samples", "ratio", "euler"), [(sphere_samples, 10, 2), (torus_samples, 16, 0)])
def test_dense_samples_end_at_sparse_ones_without_a_rim(
    samples: Callable[[int], AnalyticSamples], ratio: int, euler: int
) -> None:
    points = samples(6_000).points
    is_kept = np.random.default_rng(0).random(len(points)) < np.where(points[:, 0] > 0, 1, 1 / ratio)
    report = tk.from_points(points[torch.from_numpy(is_kept)]).report()
    assert (report.euler, report.closed) == (euler, True)
