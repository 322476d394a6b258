"""Clouds cut out of closed surfaces are open, whatever the form of their rims; closed ones stay likely."""

from __future__ import annotations

import pytest
import torch

import topokit as tk
from topokit.errors import InputError
from topokit.testing import sphere_samples, torus_samples


def bitten_torus(n_points: int = 2500) -> tuple[torch.Tensor, torch.Tensor]:
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
    known = sphere_samples(4000, generator=torch.Generator().manual_seed(0))
    spacing = (4 * torch.pi / 4000) ** 0.5
    north = torch.tensor([0.0, 0, 1], dtype=torch.float64)
    for radius, closed, verdict in ((1.5, True, "likely"), (4.0, False, "likely"), (5.0, False, "likely")):
        points = known.points[(known.points - north).norm(dim=1) > radius * spacing]
        report = tk.from_points(points).report()  # a gap of three spacings is one among random samples
        assert (report.closed, report.verdict) == (closed, verdict)
