"""`Shape.euler` is the report's integer with a gradient; χ⁽⁰⁾ is one number, whichever way it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.testing import ellipsoid_samples, genus_mesh, hemisphere_samples, sphere_samples, torus_samples

GENUS_3 = genus_mesh(3)
CLI = CliRunner()


def noisy(points: Tensor, share: float) -> Tensor:
    size = float((points.amax(0) - points.amin(0)).max())
    return points + share * size * torch.randn(points.shape, generator=torch.Generator().manual_seed(1)).double()


def of_mesh(vertices: Tensor) -> tk.Shape:
    return tk.from_mesh(vertices, GENUS_3[1], n_samples=600)


def of_points(points: Tensor) -> tk.Shape:
    known = torus_samples(800)
    return tk.from_points(points, known.normals.to(points))


LEAVES: dict[str, tuple[Callable[[], Tensor], Callable[[Tensor], tk.Shape], int]] = {
    "mesh": (lambda: torch.from_numpy(GENUS_3[0]), of_mesh, -4),
    "points": (lambda: torus_samples(800).points, of_points, 0),
    "open points": (lambda: hemisphere_samples(800).points, tk.from_points, 1),
    "noisy points": (lambda: noisy(sphere_samples(800).points, 0.005), tk.from_points, 2),
    "single precision": (lambda: torus_samples(800).points.float(), of_points, 0),
}


@pytest.mark.parametrize("name", LEAVES)
def test_the_value_is_the_integer_and_the_gradient_that_of_gauss_bonnet(name: str) -> None:
    make, shape_of, integer = LEAVES[name]
    leaf = make().requires_grad_()
    shape = shape_of(leaf)
    value = shape.euler()
    assert (value.shape, value.dtype, value.device) == ((), leaf.dtype, leaf.device)
    assert float(value.detach()) == integer == shape.report().euler
    (found,) = torch.autograd.grad(value, leaf, retain_graph=True)  # the samples are made once
    (expected,) = torch.autograd.grad(shape.gauss_bonnet(), leaf)
    assert torch.equal(found, expected)
    assert found.isfinite().all()
    assert found.abs().max() > 0


def test_gradcheck_of_gauss_bonnet() -> None:
    points = ellipsoid_samples(24, generator=torch.Generator().manual_seed(0)).points.requires_grad_()
    assert gradcheck(lambda p: tk.from_points(p).gauss_bonnet(12, boundary=False), (points,), atol=1e-4, rtol=1e-4)


def test_the_gradient_of_the_integer_is_the_slope_of_the_estimate() -> None:
    vertices = torch.from_numpy(GENUS_3[0]).requires_grad_()
    direction = torch.randn(vertices.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    (gradient,) = torch.autograd.grad(of_mesh(vertices).euler(), vertices)
    step = 1e-6
    ahead, behind = (
        float(of_mesh(vertices.detach() + sign * step * direction).gauss_bonnet(20)) for sign in (1.0, -1.0)
    )
    assert float((gradient * direction).sum()) == pytest.approx((ahead - behind) / (2 * step), rel=1e-4)


@pytest.mark.parametrize("mode", [torch.no_grad, torch.inference_mode])
def test_curvature_is_not_computed_where_no_gradient_is_asked_for(mode: Callable[[], torch.no_grad]) -> None:
    shape = of_mesh(torch.from_numpy(GENUS_3[0]).requires_grad_())
    with mode():
        assert float(shape.euler()) == -4
    assert float(tk.from_mesh(*GENUS_3).euler()) == -4
    assert "neighbors" not in shape._known._found  # the first thing that curvature needs
    assert shape.euler().requires_grad


def test_a_batch_has_the_integer_of_each_item() -> None:
    clouds = torch.stack([torus_samples(600).points, sphere_samples(600).points]).requires_grad_()
    shape = tk.from_points(clouds)
    assert shape.euler().tolist() == [0, 2]
    (found,) = torch.autograd.grad(shape.euler().sum(), clouds)
    (expected,) = torch.autograd.grad(shape.gauss_bonnet().sum(), clouds)
    assert torch.equal(found, expected)
    padded = tk.from_points(clouds.detach()[None], lengths=torch.tensor([[600, 500]]))
    assert padded.euler().shape == (1, 2)


def test_a_volume_in_blocks_has_the_integer_alone() -> None:
    volume = np.zeros((12, 12, 12), dtype=np.uint8)
    volume[2:10, 2:10, 2:10] = 1
    volume[5:7, 5:7, 2:10] = 0
    shape = tk.from_voxels(volume, block_voxels=500)
    value = shape.euler()
    assert (float(value), value.dtype, value.requires_grad) == (0, torch.float64, False)
    with pytest.raises(tk.InputError, match="counted block by block"):
        shape.gauss_bonnet()


def test_samples_that_cannot_be_made_are_an_error() -> None:
    def fail() -> tk.SurfaceSamples:
        raise tk.InputError("too few points")

    with pytest.raises(tk.InputError, match="too few points"):
        tk.Shape(fail, tk.from_mesh(*GENUS_3).counted).euler()


def test_an_unknown_integer_is_an_error_that_says_why() -> None:
    counted = tk.from_mesh(*GENUS_3).counted
    assert counted is not None
    unknown = replace(counted, evidence=replace(counted.evidence, integer=None), reasons=("It was not counted.",))
    known = torus_samples(100)
    shape = tk.Shape(tk.SurfaceSamples(known.points), unknown)
    with pytest.raises(tk.InputError, match=r"unknown.*It was not counted"):
        shape.euler()


def test_the_command_line_means_the_same(tmp_path: Path) -> None:
    path = tmp_path / "cloud.xyz"
    np.savetxt(path, noisy(torus_samples(400).points, 0.01).numpy())
    printed = CLI.invoke(app, ["euler", str(path)]).stdout
    assert int(printed.split("\t")[0]) == int(tk.load(path).euler())


CLOUDS: dict[str, Callable[[], tk.Shape]] = {
    "torus": lambda: tk.from_points(torus_samples(600).points),
    "torus, 1 % noise": lambda: tk.from_points(noisy(torus_samples(600).points, 0.01)),
    "torus, normals": lambda: tk.from_points(torus_samples(600).points, torus_samples(600).normals),
    "sphere": lambda: tk.from_points(sphere_samples(450).points),
    "sphere, 2 % noise": lambda: tk.from_points(noisy(sphere_samples(450).points, 0.02)),
    "ellipsoid, single precision": lambda: tk.from_points(ellipsoid_samples(450).points.float()),
    "half sphere": lambda: tk.from_points(hemisphere_samples(450).points),
    "half sphere, noise": lambda: tk.from_points(noisy(hemisphere_samples(450).points, 0.01)),
    "two spheres": lambda: tk.from_points(
        torch.cat((sphere_samples(450).points, noisy(sphere_samples(450).points + 3, 0.01)))
    ),
    "flat": lambda: tk.from_points(torch.rand(450, 3, generator=torch.Generator().manual_seed(0)) * torch.eye(3)[0]),
}


LONG = ("two spheres", "half sphere, noise", "sphere, 2 % noise")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name in LONG else name for name in CLOUDS]
)
def test_gauss_bonnet_the_report_and_curvature_give_one_number(name: str) -> None:
    shape = CLOUDS[name]()
    report = shape.report()
    if (near := shape._known.examination()._near) is not None:  # the report is about the points without outliers
        assert len(near) > 0.99 * len(shape.samples.points)
        shape = tk.from_points(shape.samples.points[near])
        report = shape.report()
    local, found = shape.curvature(), float(shape.gauss_bonnet())
    turning = sum(one.part.boundary.euler for one in shape._known.examinations())
    assert report.estimate == pytest.approx(found, abs=1e-9)
    assert float((local.gaussian * local.area).sum()) / (2 * np.pi) + turning == pytest.approx(found, abs=1e-5)
    parts = [part.estimate for part in report.per_component if part.estimate is not None]
    if parts:
        assert sum(parts) + turning == pytest.approx(found, abs=1e-5)


def test_details_of_a_report_do_not_depend_on_the_number_of_neighbors() -> None:
    for shape in (tk.from_mesh(*GENUS_3, n_samples=600), tk.from_points(noisy(torus_samples(800).points, 0.01))):
        report = shape.report(details=True)
        assert report.estimate == pytest.approx(float(shape.gauss_bonnet()), abs=1e-9)
        few = shape.replace(n_neighbors=9)
        other = few.report(details=True)
        assert (other.estimate, other.refined) == (report.estimate, report.refined)
        assert float(few.gauss_bonnet()) != report.estimate
