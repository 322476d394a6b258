"""Reports of clouds: verdicts, components, nesting, orientation, and degenerate input."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.core.mesh.sampling import sample_triangles
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError, TopokitError
from topokit.testing import genus_mesh, icosphere, sphere_samples, torus_mesh, torus_samples


def test_a_genus_two_cloud_is_likely_and_tells_its_genus() -> None:
    vertices, faces = (torch.from_numpy(part) for part in genus_mesh(2))
    samples, _ = sample_triangles(vertices, faces, 1500)
    for normals in (None, samples.normals):
        shape = tk.from_points(samples.points, normals)
        report = shape.report(details=True)
        assert (report.euler, report.genus, report.verdict, report.closed) == (-2, 2, "likely", True)
        assert (report.surface_betti, report.solid_betti) == ((1, 4, 1), (1, 2, 0))
        assert shape.genus() == 2
        assert report.refined == pytest.approx(-2, abs=1e-3)
        names = ["Gauss–Bonnet", "Delaunay cuts", "winding-number fields", "Gauss–Bonnet, self-optimized"]
        assert [one.name for one in report.evidence] == names
        assert report.resolution is not None
        assert 2 < report.resolution / (samples.points.shape[0] ** -0.5) < 40


def test_nested_and_separate_parts_are_told_apart() -> None:
    outer, inner = sphere_samples(600), sphere_samples(300, radius=0.5)
    torus = torus_samples(600)
    points = torch.cat((outer.points, inner.points, torus.points + 4))
    report = tk.from_points(points).report()
    assert (report.euler, report.components, report.cavities, report.genus) == (4, 3, 1, 1)
    assert (report.surface_betti, report.solid_betti) == ((3, 2, 3), (2, 1, 1))
    assert "bounding a solid of 2 pieces with 1 tunnel and 1 cavity" in str(report)
    by_euler = {(part.euler, part.depth) for part in report.per_component}
    assert by_euler == {(2, 0), (2, 1), (0, 0)}
    inside = next(part for part in report.per_component if part.depth == 1)
    assert inside.inside is not None
    assert report.per_component[inside.inside].euler == 2
    assert sum(part.area_share for part in report.per_component) == pytest.approx(1)


def test_oriented_gives_outward_normals_that_follow_the_points() -> None:
    known = torus_samples(2000)
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
    known = torus_samples(1500)
    report = tk.from_points(known.points, -known.normals).report()
    assert report.euler == 0
    assert any("point inward" in reason for reason in report.reasons)
    flipped = torch.where(torch.arange(1500)[:, None] % 3 == 0, -known.normals, known.normals)
    report = tk.from_points(known.points, flipped).report()
    assert report.verdict == "unsure"
    assert "contradict each other" in report.reasons[0], "what decided comes first"


@pytest.mark.parametrize(
    ("points", "verdict"),
    [
        (
            torch.cat(
                (torch.rand(400, 2, generator=torch.Generator().manual_seed(0)), torch.zeros(400, 1)), dim=1
            ).double(),
            "likely",
        ),
        (torch.linspace(0, 1, 200, dtype=torch.float64)[:, None].expand(200, 3).clone(), "unsure"),
    ],
    ids=["square", "line"],
)
def test_what_bounds_no_solid_is_open_with_the_reason(points: torch.Tensor, verdict: str) -> None:
    shape = tk.from_points(points)
    report = shape.report()
    assert (report.verdict, report.closed) == (verdict, False)
    assert any("No solid can be found from these points" in reason for reason in report.reasons)
    json.loads(report.to_json())
    assert bool(shape.gauss_bonnet().isfinite())
    with pytest.raises(InputError):
        shape.oriented()
    if report.boundary_loops:  # of the square
        assert (report.euler, shape.genus()) == (1, 0)
    else:
        with pytest.raises(TopokitError):
            shape.genus()


def test_samples_along_scan_lines_are_not_believed() -> None:
    height = torch.linspace(-0.98, 0.98, 16, dtype=torch.float64).repeat_interleave(120)
    angle = torch.linspace(0, 6.28, 120, dtype=torch.float64).repeat(16)
    ring = (1 - height.square()).sqrt()
    report = tk.from_points(torch.stack((ring * angle.cos(), ring * angle.sin(), height), dim=1)).report()
    assert report.verdict == "unsure"
    assert any("one side only" in reason or "not closed" in reason for reason in report.reasons)


def test_a_cluster_and_a_few_points_do_not_hang() -> None:
    random = torch.Generator().manual_seed(2)
    for points in (torch.randn(250, 3, generator=random).double(), torch.randn(22, 3, generator=random).double()):
        report = tk.from_points(points).report()
        assert report.verdict == "unsure"
        json.loads(report.to_json())
    with pytest.raises(InputError, match="2 points, too few"):
        tk.from_points(torch.zeros(2, 3, dtype=torch.float64))


def test_a_large_offset_changes_nothing() -> None:
    known = torus_samples(1500)
    here, there = (tk.from_points(known.points + offset).report() for offset in (0, 1e6))
    assert (here.euler, here.verdict) == (there.euler, there.verdict)
    assert here.resolution == pytest.approx(there.resolution, rel=1e-3)


def test_reports_are_deterministic_and_json() -> None:
    points = torus_samples(1000).points
    reports = [tk.from_points(points).report() for _ in range(2)]
    first, second = (report.to_dict() for report in reports)
    for one in (first, second):
        one["evidence"] = [{**row, "seconds": 0} for row in one["evidence"]]
    assert first == second
    assert json.loads(reports[0].to_json())["euler"] == 0


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


def test_estimates_of_a_shape_are_what_their_names_say() -> None:
    """χ⁽⁰⁾ is the plain sum, χ⁽ᴷ⁾ meets the witness's integer or the caller's, χ_τ needs a field."""
    points = sphere_samples(1500).points
    shape = tk.from_points(points)
    for options in ({}, {"normal_method": "pca"}):
        local = shape.curvature(**options)
        assert torch.equal(shape.gauss_bonnet(**options), (local.gaussian * local.area).sum() / (2 * torch.pi))
    assert 0.001 < abs(float(shape.gauss_bonnet()) - 2) < 0.02
    assert abs(float(shape.gauss_bonnet(normal_method="pca")) - 2) > 0.05
    assert float(shape.refined_euler()) == pytest.approx(2, abs=1e-3)
    assert float(shape.refined_euler(1.5)) == pytest.approx(1.5, abs=1e-3)
    for step in ("polyak", "gradient"):
        with torch.no_grad():
            quiet = shape.refined_euler(2, step=step, max_steps=3)
        assert torch.equal(quiet, shape.refined_euler(2, step=step, max_steps=3).detach())
    with pytest.raises(InputError, match="has no field"):
        shape.smoothed_euler()


def test_methods_reach_curvature_and_euler() -> None:
    shape = tk.from_points(torus_samples(1500).points)
    plain, default = shape.curvature(), float(shape.gauss_bonnet())
    for options in (
        {"n_neighbors": 8},
        {"n_neighbors": 30},
        {"solver": "symmetrized"},
        {"solver": "plain"},
        {"solver": "commuting"},
        {"area_method": "monte-carlo"},
        {"normal_method": "pca"},
    ):
        changed = shape.curvature(**options)  # type: ignore[arg-type]
        assert not torch.equal(changed.gaussian * changed.area, plain.gaussian * plain.area), options
        value = float(shape.gauss_bonnet(**options))  # type: ignore[arg-type]
        assert value != default, options
        assert value == pytest.approx(float((changed.gaussian * changed.area).sum() / (2 * torch.pi)))
    coarse, fine = (float(shape.gauss_bonnet(area_method="monte-carlo", area_resolution=n)) for n in (4, 64))
    assert abs(fine - default) < abs(coarse - default)
    for wrong in (2, 0, -1):
        with pytest.raises(InputError, match="at least 3"):
            shape.gauss_bonnet(wrong)


def test_shapes_move_between_types() -> None:
    shape = tk.from_mesh(genus_mesh(1), n_samples=500)
    single = shape.to(torch.float32)
    assert (shape.dtype, single.dtype, single.device.type) == (torch.float64, torch.float32, "cpu")
    assert single.mesh is not None
    assert (single.mesh[0].dtype, single.mesh[1].dtype) == (torch.float32, torch.int64)
    assert single.report().euler == shape.report().euler == 0
    assert float(single.gauss_bonnet()) == pytest.approx(float(shape.gauss_bonnet()), abs=1e-2)


def test_counted_shapes_pay_for_nothing_that_was_not_asked() -> None:
    asked = []

    def samples() -> SurfaceSamples:
        asked.append("samples")
        known = sphere_samples(200)
        return SurfaceSamples(known.points, known.normals)

    mesh = tk.from_mesh(genus_mesh(2))
    shape = tk.Shape(samples, mesh.counted)
    report = shape.report()
    assert (report.euler, report.estimate, report.refined, report.solid) == (-2, None, None, None)
    assert shape.genus() == 2
    assert asked == []
    assert shape.report(details=True).estimate == pytest.approx(2, abs=0.2)
    assert asked == ["samples"]


def test_details_of_a_mesh_tell_the_solid_it_encloses() -> None:
    (vertices, faces), shift = icosphere(4), 0.4
    overlapping = (
        torch.cat((torch.from_numpy(vertices), torch.from_numpy(vertices) + shift)),
        torch.cat((torch.from_numpy(faces), torch.from_numpy(faces) + len(vertices))),
    )
    report = tk.from_mesh(overlapping).report(details=True)
    assert (report.euler, report.verdict) == (4, "certain")
    assert report.solid is not None
    assert report.solid.euler == 2
    assert "intersects or overlaps itself" in report.reasons[-1]
    assert report.estimate is not None
    assert report.refined == pytest.approx(4, abs=1e-3)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is such a device")
def test_a_device_that_is_not_there_is_an_error_of_ours() -> None:
    shape = tk.from_mesh(icosphere(1))
    for device in ("cuda", "nonsense"):
        with pytest.raises(tk.InputError, match="cannot be moved"):
            shape.to(device)


def test_a_report_of_points_is_four_lines_and_has_all_reasons_on_request() -> None:
    shape = tk.from_points(torus_samples(1000).points)
    report = shape.report()
    assert len(report.reasons) > 4
    short, full = str(report).splitlines(), report.text(full=True).splitlines()
    assert (len(short), len(full)) == (4, 1 + len(report.reasons) + 1)
    assert full[-1] == f"  Advice: {report.advice}"
    assert short[:3] == full[:3]
    assert f"{len(report.reasons) - 2} more reasons" in short[3]
    assert report.reasons[-1] in str(shape.report(details=True))


def test_an_error_quotes_the_first_reason_alone() -> None:
    vertices, faces = torus_mesh(24, 12)
    thrice = np.concatenate((faces, [[*faces[0, :2], faces[100, 0]]]))  # an edge with three faces, and boundary
    shape = tk.from_mesh(vertices, thrice)
    first, second = shape.report().reasons[:2]
    with pytest.raises(InputError, match="2 more reasons") as caught:
        shape.surface()
    assert first in str(caught.value)
    assert second not in str(caught.value)
