"""Open surfaces: detection and location of the boundary, and the Euler characteristic with its turning."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial

import pytest
import torch

import topokit as tk
from topokit.core.local.boundary import has_gap
from topokit.core.local.voronoi import cell_vertices
from topokit.testing import (
    AnalyticSamples,
    cylinder_samples,
    hemisphere_samples,
    icosphere,
    plate_samples,
    sphere_samples,
    torus_samples,
)

N = 1200
N_PIERCED = 2000  # of the square with a hole, whose width is in doubt with fewer


def cloud(name: str) -> AnalyticSamples:
    if name in ("cap", "half torus"):
        whole, axis, least = (sphere_samples(2 * N), 2, 0.6) if name == "cap" else (torus_samples(2 * N), 0, 0.0)
        kept = whole.points[:, axis] > least
        return replace(whole, points=whole.points[kept], normals=whole.normals[kept])
    makers = {
        "hemisphere": hemisphere_samples,
        "cylinder": cylinder_samples,
        "square": partial(plate_samples, hole=0.0),
    }
    return makers[name](N) if name in makers else plate_samples(N_PIERCED)


@pytest.mark.parametrize("k", [6, 20])
def test_gaps_are_those_between_sorted_directions(k: int, generator: torch.Generator) -> None:
    around = torch.randn(2000, k, 2, generator=generator, dtype=torch.float64)
    half = torch.rand(500, k, 2, generator=generator, dtype=torch.float64) - torch.tensor([0.5, 0.1])
    tangent = torch.cat((around, half))
    degrees = torch.atan2(tangent[..., 1], tangent[..., 0]).rad2deg().sort(-1).values
    widest = degrees.diff(dim=-1, append=degrees[:, :1] + 360).amax(-1)
    some = tangent * (torch.rand(2500, k, 1, generator=generator) < 0.8)  # cells may leave out neighbors
    for seen in (tangent, some):
        assert torch.equal(has_gap(tangent, cell_vertices(seen)), widest > 110)
    assert 0.01 < float((widest > 110).double().mean()) < 0.99


@cache
def open_shape(name: str, *, with_normals: bool) -> tk.Shape:
    known = cloud(name)
    return tk.from_points(known.points, known.normals if with_normals else None)


SURFACES = {
    "hemisphere": (1, 1),
    "cap": (1, 1),
    "square": (1, 1),
    "cylinder": (0, 2),
    "square with a hole": (0, 2),
    "half torus": (0, 2),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("with_normals", [True, False])
def test_open_surfaces(name: str, with_normals: bool) -> None:
    euler, loops = SURFACES[name]
    shape = open_shape(name, with_normals=with_normals)
    report = shape.report()
    assert (report.euler, report.closed, report.verdict) == (euler, False, "likely")
    assert report.genus == shape.genus() == (2 * report.components - loops - euler) // 2 == 0
    assert report.boundary_loops == loops
    assert report.estimate == pytest.approx(euler, abs=0.3)
    assert any("total length of" in reason for reason in report.reasons)
    assert abs(float(shape.gauss_bonnet()) - euler) < 0.3


def test_reports_locate_the_boundary() -> None:
    shape = open_shape("hemisphere", with_normals=True)
    report = shape.report()
    sentence = next(reason for reason in report.reasons if "not closed" in reason)
    length = float(sentence.split("total length of ")[1].split(",")[0])
    assert length == pytest.approx(2 * math.pi, rel=0.05)
    [rim] = shape.boundaries()
    assert rim.length == pytest.approx(length, rel=1e-3)
    low = sentence.split("between (")[1].split(")")[0].split(", ")
    assert float(low[0]) == pytest.approx(-1, abs=0.05)
    assert float(low[2]) == pytest.approx(0, abs=0.1)


def test_closed_surfaces_have_no_boundary() -> None:
    for known in (sphere_samples(2000), torus_samples(2000)):
        report = tk.from_points(known.points).report()
        assert report.closed
        assert report.boundary_loops == 0


def test_an_open_mesh_meets_its_counted_integer() -> None:
    vertices, faces = icosphere(4)
    upper = (vertices[faces].mean(1)[:, 2] > 0.2).nonzero()[0]
    shape = tk.from_mesh((vertices, faces[upper]))
    assert shape.report().euler == 1
    assert abs(float(shape.refined_euler()) - 1) < 1e-3
