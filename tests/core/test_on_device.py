"""Curvature and χ as accelerators compute them: no look at the device, the results of the CPU, every shape of batch."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

import topokit as tk
from topokit.core.linalg import eigenvector_by_rotations
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.local.voronoi import exact_cell_areas
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.testing import as_on_accelerator, count_host_visits, ellipsoid_samples, sphere_samples, torus_samples


def euler_of(points: Tensor, normals: Tensor | None) -> Tensor:
    return tk.from_points(points, normals).gauss_bonnet(20, boundary=False)


def mean_curvature_of(points: Tensor, normals: Tensor | None) -> Tensor:
    return tk.from_points(points, normals).curvature(20).mean.square()


@pytest.mark.parametrize("with_normals", [True, False])
@pytest.mark.parametrize("question", [euler_of, mean_curvature_of])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.float16])
def test_no_look_at_the_device_forward_or_backward(question, with_normals: bool, dtype: torch.dtype) -> None:  # type: ignore[no-untyped-def]
    known = torus_samples(300)
    points = known.points.to(dtype).requires_grad_()
    with as_on_accelerator(), count_host_visits() as visits:
        question(points, known.normals if with_normals else None).sum().backward()
    assert len(visits) == 0, str(visits)
    assert points.grad is not None
    assert points.grad.isfinite().all()


class Operations(TorchDispatchMode):
    """How many operations ran."""

    count = 0

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):  # type: ignore[no-untyped-def]
        self.count += 1
        return operation(*args, **(kwargs or {}))


def test_a_field_takes_as_many_operations_whatever_its_size() -> None:
    loss, counts = tk.losses.EulerLoss(2), []
    for size in (16, 72):  # parts that fit the cache would be five
        field = torch.randn(size, size, size, dtype=torch.float64, requires_grad=True)
        with as_on_accelerator(), count_host_visits() as visits, Operations() as operations:
            loss(field, 0.5).backward()
        assert len(visits) == 0, str(visits)
        counts.append(operations.count)
    assert counts[0] == counts[1]


def test_all_work_is_done_where_the_samples_are() -> None:
    """Tensors on the device "meta" have no values: whatever looks at values, or mixes devices, raises."""
    points, normals = (torch.randn(3, 200, 3, device="meta") for _ in range(2))
    points.requires_grad_()
    value = tk.from_points(points, normals).gauss_bonnet(20, boundary=False)
    assert value.device.type == "meta"
    assert value.shape == (3,)
    value.sum().backward()
    lengths = torch.full((3,), 150, device="meta")
    local = tk.from_points(points, lengths=lengths).curvature(12)
    assert {part.device.type for part in vars(local).values()} == {"meta"}


@pytest.mark.parametrize("make", [torus_samples, ellipsoid_samples, sphere_samples])
@pytest.mark.parametrize("method", ["pca", "quadric"])
def test_the_values_and_gradients_are_those_of_the_cpu(make, method: str) -> None:  # type: ignore[no-untyped-def]
    points = make(600).points
    found = []
    for context in (torch.enable_grad, as_on_accelerator):
        leaf = points.clone().requires_grad_()
        with context():
            local = surface_curvature(SurfaceSamples(leaf), CurvatureSettings(16, normal_method=method))  # type: ignore[arg-type]
            (euler_characteristic(local.gaussian, local.area) + local.total.mean()).backward()
        found.append((local.gaussian, local.total, local.area, local.is_boundary, leaf.grad))
    for here, there in zip(*found, strict=True):
        torch.testing.assert_close(there, here, rtol=1e-6, atol=1e-6)


def neighborhoods(kind: str) -> Tensor:
    random = torch.Generator().manual_seed(1)
    if kind == "general":
        return torch.randn(200, 20, 2, generator=random, dtype=torch.float64)
    if kind == "lattice":
        return torch.randint(-3, 4, (200, 20, 2), generator=random).double()
    if kind == "one side":
        return torch.rand(200, 20, 2, generator=random, dtype=torch.float64)
    if kind == "line":
        return torch.randn(200, 20, 1, generator=random, dtype=torch.float64) * torch.tensor([1.0, 2.0])
    return torch.zeros(4, 5, 2, dtype=torch.float64)


@pytest.mark.parametrize("kind", ["general", "lattice", "one side", "line", "one place"])
def test_both_ways_to_find_a_cell_find_the_same(kind: str) -> None:
    areas, is_open = exact_cell_areas(neighborhoods(kind))
    leaf = neighborhoods(kind).requires_grad_()
    with as_on_accelerator():
        dense, dense_open = exact_cell_areas(leaf)
    torch.testing.assert_close(dense, areas)
    assert torch.equal(dense_open, is_open)
    dense.sum().backward()
    assert leaf.grad is not None
    assert leaf.grad.isfinite().all()


@pytest.mark.parametrize("thinness", [1.0, 1e-3, 0.0])
def test_rotations_find_the_eigenvector_of_the_library(thinness: float, generator: torch.Generator) -> None:
    points = torch.randn(500, 9, 3, generator=generator, dtype=torch.float64)
    turn = torch.linalg.qr(torch.randn(500, 3, 3, generator=generator, dtype=torch.float64)).Q
    points = points * torch.tensor([1.0, 0.5, 0.2 * thinness]) @ turn
    covariance = points.mT @ points
    expected = torch.linalg.eigh(covariance).eigenvectors[..., 0]
    found = eigenvector_by_rotations(covariance)
    torch.testing.assert_close((found * expected).sum(-1).abs(), torch.ones(500, dtype=torch.float64))
    assert eigenvector_by_rotations(torch.eye(3)[None]).norm() == 1


def ragged() -> tuple[Tensor, Tensor, list[int]]:
    """Three clouds of different size; the padding is NaN and must not matter."""
    clouds, lengths = [sphere_samples(400), torus_samples(300), ellipsoid_samples(210)], [400, 300, 210]
    points = torch.full((3, 400, 3), torch.nan, dtype=torch.float64)
    normals = torch.full_like(points, torch.nan)
    for row, (known, length) in enumerate(zip(clouds, lengths, strict=True)):
        points[row, :length], normals[row, :length] = known.points, known.normals
    return points, normals, lengths


@pytest.mark.parametrize("with_normals", [True, False])
@pytest.mark.parametrize("on_device", [True, False])
def test_clouds_of_different_size_are_each_what_they_are_alone(with_normals: bool, on_device: bool) -> None:
    points, normals, lengths = ragged()
    points.requires_grad_()
    with as_on_accelerator() if on_device else torch.enable_grad():
        batch = tk.from_points(points, normals if with_normals else None, lengths=lengths)
        together = batch.gauss_bonnet(20, boundary=False)
        alone = [
            tk.from_points(points[row, :length], normals[row, :length] if with_normals else None)
            for row, length in enumerate(lengths)
        ]
        torch.testing.assert_close(together, torch.stack([one.gauss_bonnet(20, boundary=False) for one in alone]))
        assert (batch.curvature().area[1, 300:] == 0).all()
    if not on_device:
        torch.testing.assert_close(batch.gauss_bonnet(), torch.stack([one.gauss_bonnet() for one in alone]))
    (gradient,) = torch.autograd.grad(together.sum(), points)
    assert gradient.isfinite().all()
    assert (gradient[2, 210:] == 0).all()
    assert (gradient[2, :210] != 0).any()


@pytest.mark.filterwarnings("ignore:The PyTorch API of nested tensors is in prototype stage")
@pytest.mark.parametrize("layout", [torch.jagged, torch.strided])
@pytest.mark.parametrize("with_normals", [True, False])
def test_nested_tensors_are_clouds_of_different_size(layout: torch.layout, with_normals: bool) -> None:
    points, normals, lengths = ragged()

    def clouds_of(batch: Tensor) -> list[Tensor]:
        return [cloud[:length].clone().requires_grad_() for cloud, length in zip(batch, lengths, strict=True)]

    clouds, directions = clouds_of(points), clouds_of(normals)
    nested, nested_normals = (torch.nested.as_nested_tensor(parts, layout=layout) for parts in (clouds, directions))
    shape = tk.from_points(nested, nested_normals if with_normals else None)
    padded = tk.from_points(points, normals if with_normals else None, lengths=lengths)
    value = shape.gauss_bonnet(20, boundary=False)
    assert torch.equal(value, padded.gauss_bonnet(20, boundary=False))
    value.sum().backward()
    for number, (cloud, direction) in enumerate(zip(clouds, directions, strict=True)):
        leaf = points[number, : lengths[number]].clone().requires_grad_()
        alone = tk.from_points(leaf, normals[number, : lengths[number]] if with_normals else None)
        alone.gauss_bonnet(20, boundary=False).backward()
        torch.testing.assert_close(cloud.grad, leaf.grad)
        assert (direction.grad is not None) == with_normals


def test_nested_tensors_in_half_precision_are_widened() -> None:
    nested = torch.nested.as_nested_tensor([sphere_samples(n).points.half() for n in (90, 60)], layout=torch.jagged)
    with as_on_accelerator():
        shape = tk.from_points(nested)
        with count_host_visits() as visits:
            value = shape.gauss_bonnet(20, boundary=False)
    assert len(visits) == 0, str(visits)
    assert value.dtype == torch.float32


def test_nested_tensors_that_do_not_fit_are_refused() -> None:
    def nested(*sizes: int, width: int = 3) -> Tensor:
        return torch.nested.as_nested_tensor([torch.rand(size, width) for size in sizes], layout=torch.jagged)

    points = nested(30, 40)
    for options, message in [
        ({"points": nested(30, 40, width=2)}, r"clouds \(Nᵢ, 3\), got 2 items of shapes \[\(30, 2\), \(40, 2\)\]"),
        ({"points": nested(30, 12)}, "lengths must lie between 21"),
        ({"points": points, "lengths": [30, 40]}, "leave lengths out"),
        ({"points": points, "normals": nested(40, 30)}, r"\[30, 40\], got \[40, 30\]"),
        ({"points": points, "normals": torch.rand(2, 40, 3)}, "nest both, or neither"),
        ({"points": torch.rand(2, 40, 3), "normals": points}, "nest both, or neither"),
    ]:
        with pytest.raises(InputError, match=message):
            tk.from_points(**options)


def test_lengths_are_checked() -> None:
    points = torch.zeros(2, 30, 3)
    with pytest.raises(InputError, match=r"between 21, .* and 30"):
        tk.from_points(points, lengths=[30, 20])
    with pytest.raises(InputError, match="one number for each cloud"):
        tk.from_points(points, lengths=[30, 30, 30])
    with pytest.raises(InputError, match="int64 tensor"):
        SurfaceSamples(points, lengths=torch.tensor([30.0, 30.0]))
    with pytest.raises(InputError, match="different sizes"):
        tk.from_points(*ragged()[:2], lengths=ragged()[2]).refined_euler(2)


@pytest.mark.long
def test_the_example_watches_a_training() -> None:
    example = Path(__file__).resolve().parents[2] / "examples" / "monitor_training.py"
    command = [sys.executable, str(example), "--clouds", "2", "--points", "800", "--steps", "3"]
    ran = subprocess.run(
        command, capture_output=True, text=True, encoding="utf-8", env=os.environ | {"PYTHONUTF8": "1"}
    )
    assert ran.returncode == 0, ran.stderr
    least_sphere, most_sphere, least_torus, most_torus = map(float, re.findall(r"([+-]\d\.\d\d)", ran.stdout))
    assert 1.8 < least_sphere <= most_sphere < 2.2
    assert -0.5 < least_torus <= most_torus < 0.5
    assert re.search(r"watching adds \d+ %", ran.stdout)


def test_a_report_refuses_values_that_were_not_looked_at() -> None:
    points = sphere_samples(300).points.clone()
    points[7] = torch.nan
    with as_on_accelerator():
        shape = tk.from_points(points)
        assert shape.gauss_bonnet(20, boundary=False).isnan()
        with pytest.raises(InputError, match="3 values that are NaN"):
            shape.report()
    assert tk.from_points(points).samples.n_points == 299
