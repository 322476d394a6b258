"""Reports of clouds: verdicts, components, nesting, orientation, and degenerate input."""

from __future__ import annotations

import json

import pytest
import torch

import topokit as tk
from topokit.core.mesh.sampling import sample_triangles
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError, TopokitError
from topokit.testing import genus_mesh, sphere_samples, torus_samples


def test_a_genus_two_cloud_is_likely_and_tells_its_genus() -> None:
    vertices, faces = (torch.from_numpy(part) for part in genus_mesh(2))
    samples, _ = sample_triangles(vertices, faces, 6000)
    for normals in (None, samples.normals):
        shape = tk.from_points(samples.points, normals)
        report = shape.report()
        assert (report.euler, report.genus, report.verdict, report.closed) == (-2, 2, "likely", True)
        assert report.betti == (1, 4, 1)
        assert shape.genus() == 2
        assert report.refined == pytest.approx(-2, abs=1e-3)
        assert {one.name for one in report.evidence} >= {"Gauss–Bonnet", "Delaunay cuts", "winding-number fields"}
        assert report.resolution is not None
        assert 2 < report.resolution / (samples.points.shape[0] ** -0.5) < 40


def test_nested_and_separate_parts_are_told_apart() -> None:
    outer, inner = sphere_samples(4000), sphere_samples(2000, radius=0.5)
    torus = torus_samples(3000)
    points = torch.cat((outer.points, inner.points, torus.points + 4))
    report = tk.from_points(points).report()
    assert (report.euler, report.components, report.cavities, report.genus) == (4, 3, 1, 1)
    by_euler = {(part.euler, part.depth) for part in report.per_component}
    assert by_euler == {(2, 0), (2, 1), (0, 0)}
    inside = next(part for part in report.per_component if part.depth == 1)
    assert inside.inside is not None
    assert report.per_component[inside.inside].euler == 2
    assert sum(part.area_share for part in report.per_component) == pytest.approx(1)


def test_oriented_gives_outward_normals_that_follow_the_points() -> None:
    known = torus_samples(4000)
    points = known.points.clone().requires_grad_()
    shape = tk.from_points(points).oriented()
    assert shape.samples.normals is not None
    assert float(((shape.samples.normals * known.normals).sum(-1) > 0).double().mean()) > 0.999
    curvature = shape.curvature()
    assert float(((curvature.mean > 0) == (known.mean > 0)).double().mean()) > 0.95
    curvature.mean.sum().backward()
    assert points.grad is not None
    assert points.grad.isfinite().all()
    assert shape.oriented() is shape


def test_flipped_normals_are_noticed() -> None:
    known = torus_samples(3000)
    report = tk.from_points(known.points, -known.normals).report()
    assert report.euler == 0
    assert any("inward" in reason for reason in report.reasons)
    flipped = torch.where(torch.arange(3000)[:, None] % 3 == 0, -known.normals, known.normals)
    report = tk.from_points(known.points, flipped).report()
    assert report.verdict == "unsure"
    assert any("contradict each other" in reason for reason in report.reasons)


@pytest.mark.parametrize(
    "points",
    [
        torch.cat(
            (torch.rand(400, 2, generator=torch.Generator().manual_seed(0)), torch.zeros(400, 1)), dim=1
        ).double(),
        torch.linspace(0, 1, 200, dtype=torch.float64)[:, None].expand(200, 3).clone(),
        torch.ones(100, 3, dtype=torch.float64),
    ],
    ids=["plane", "line", "all equal"],
)
def test_what_bounds_no_solid_is_unsure_with_the_reason(points: torch.Tensor) -> None:
    shape = tk.from_points(points)
    report = shape.report()
    assert (report.verdict, report.closed, report.genus) == ("unsure", False, None)
    assert any("No solid can be found from these points" in reason for reason in report.reasons)
    json.loads(report.to_json())
    assert bool(shape.euler().isfinite())
    with pytest.raises(InputError):
        shape.oriented()
    with pytest.raises(TopokitError):
        shape.genus()


def test_samples_along_scan_lines_are_not_believed() -> None:
    height = torch.linspace(-0.98, 0.98, 24, dtype=torch.float64).repeat_interleave(300)
    angle = torch.linspace(0, 6.28, 300, dtype=torch.float64).repeat(24)
    ring = (1 - height.square()).sqrt()
    report = tk.from_points(torch.stack((ring * angle.cos(), ring * angle.sin(), height), dim=1)).report()
    assert report.verdict == "unsure"
    assert any("one side only" in reason or "not closed" in reason for reason in report.reasons)


def test_a_cluster_and_a_few_points_do_not_hang() -> None:
    random = torch.Generator().manual_seed(2)
    for points in (torch.randn(500, 3, generator=random).double(), torch.randn(22, 3, generator=random).double()):
        report = tk.from_points(points).report()
        assert report.verdict == "unsure"
        json.loads(report.to_json())
    with pytest.raises(InputError, match="2 points, too few"):
        tk.from_points(torch.zeros(2, 3, dtype=torch.float64))


def test_a_large_offset_changes_nothing() -> None:
    known = torus_samples(3000)
    here, there = (tk.from_points(known.points + offset).report() for offset in (0, 1e6))
    assert (here.euler, here.verdict) == (there.euler, there.verdict)
    assert here.resolution == pytest.approx(there.resolution, rel=1e-3)


def test_reports_are_deterministic_and_json() -> None:
    points = torus_samples(2500).points
    first, second = (tk.from_points(points).report().to_dict() for _ in range(2))
    for one in (first, second):
        one["evidence"] = [{**row, "seconds": 0} for row in one["evidence"]]
    assert first == second
    assert json.loads(tk.from_points(points).report().to_json())["euler"] == 0


def test_samples_are_checked() -> None:
    points = torch.zeros(30, 3)
    for wrong, message in (
        ({"points": points.int()}, "must be a floating-point tensor"),
        ({"points": torch.zeros(30, 2)}, r"points must have shape \(..., N, 3\)"),
        ({"points": points, "normals": torch.zeros(29, 3)}, r"normals must have shape \(30, 3\)"),
        ({"points": points, "normals": torch.zeros(30, 3).double()}, "convert one of them"),
        ({"points": points / 0}, "NaN or infinite"),
        ({"points": [[0.0] * 3] * 30}, "must be a torch.Tensor, got list"),
    ):
        with pytest.raises(InputError, match=message):
            SurfaceSamples(**wrong)  # type: ignore[arg-type]
