"""Gradients of samples, curvature and χ of volumes with respect to the voxels, against differences."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

import topokit as tk
from topokit.errors import InputError

PLACE: dict[str, Any] = {"spacing": (1.0, 0.8, 1.3), "origin": (5.0, -2.0, 1.0)}


def axes(n: int) -> tuple[Tensor, ...]:
    axis = torch.linspace(-1, 1, n, dtype=torch.float64)
    return torch.meshgrid(axis, axis, axis, indexing="ij")


def noisy(field: Callable[[Tensor, Tensor, Tensor], Tensor], n: int = 20) -> Tensor:
    generator = torch.Generator().manual_seed(0)
    return field(*axes(n)) + 0.02 * torch.randn(n, n, n, generator=generator, dtype=torch.float64)


SPHERE = noisy(lambda x, y, z: 0.6 - (x * x + y * y + z * z).sqrt())
TORUS = noisy(lambda x, y, z: 0.25 - torch.hypot(torch.hypot(x, y) - 0.55, z))
CUT_BY_THE_BORDER = noisy(lambda x, y, z: 1 - (x * x / 1.2 + y * y / 0.4 + z * z / 0.3))
THIN_SHEET = noisy(lambda x, y, z: torch.where((z - 0.05).abs() < 0.06, 0.5, -0.5), 16)
BINARY = (SPHERE > 0).double()


def gauss_bonnet(shape: tk.Shape) -> Tensor:
    return shape.gauss_bonnet(20, boundary=False)


def weighted_curvature(shape: tk.Shape) -> Tensor:
    gaussian = shape.curvature(20).gaussian
    return (gaussian.tanh() * torch.linspace(0, 1, len(gaussian), dtype=torch.float64)).sum()


@pytest.mark.parametrize("question", [gauss_bonnet, weighted_curvature])
@pytest.mark.parametrize(
    ("volume", "level"),
    [(SPHERE, 0.0), (TORUS + 3, 3.0), (CUT_BY_THE_BORDER, 0.0), (THIN_SHEET, 0.0), (BINARY, 0.5)],
    ids=["sphere", "torus", "cut by the border", "thin sheet", "binary"],
)
def test_slopes_are_those_of_differences(volume: Tensor, level: float, question: Callable[[tk.Shape], Tensor]) -> None:
    """Along random directions, with samples that follow from the same starts; the lowest voxels stay as they are."""
    starts = tk.from_voxels(volume, level=level, n_samples=600, **PLACE).samples.points

    def answer(values: Tensor) -> Tensor:
        return question(tk.from_voxels(values, level=level, starts=starts, **PLACE))

    leaf = volume.clone().requires_grad_()
    (slope,) = torch.autograd.grad(answer(leaf), leaf)
    generator = torch.Generator().manual_seed(1)
    for _ in range(2):
        direction = torch.randn(volume.shape, generator=generator, dtype=torch.float64)
        direction[volume <= volume.quantile(0.1)] = 0  # outside the volume is the lowest value, which is held fixed
        step = 1e-6 * direction
        difference = float(answer(volume + step) - answer(volume - step)) / 2e-6
        assert float((slope * direction).sum()) == pytest.approx(difference, rel=1e-5, abs=1e-6)


def test_samples_and_normals_pass_gradcheck() -> None:
    volume = noisy(lambda x, y, z: 0.6 - (x * x + y * y + z * z).sqrt(), 9)
    starts = tk.from_voxels(volume, level=0.0, n_samples=30).samples.points

    def samples(inner: Tensor) -> tuple[Tensor, Tensor]:
        values = volume.clone()
        values[2:-2, 2:-2, 2:-2] = inner
        found = tk.from_voxels(values, level=0.0, starts=starts).samples
        assert found.normals is not None
        return found.points, found.normals

    assert torch.autograd.gradcheck(samples, volume[2:-2, 2:-2, 2:-2].clone().requires_grad_(), fast_mode=True)


def test_the_integer_has_the_gradient_of_gauss_bonnet() -> None:
    def slope(answer: Callable[[tk.Shape], Tensor]) -> tuple[float, Tensor]:
        leaf = TORUS.clone().requires_grad_()
        value = answer(tk.from_voxels(leaf, level=0.0, n_samples=500))
        return float(value.detach()), torch.autograd.grad(value, leaf)[0]

    (integer, straight), (estimate, expected) = slope(tk.Shape.euler), slope(tk.Shape.gauss_bonnet)
    assert integer == 0 != estimate
    assert torch.equal(straight, expected)
    assert expected.abs().sum() > 0


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32])
def test_the_gradient_has_the_type_of_the_volume(dtype: torch.dtype) -> None:
    leaf = SPHERE.to(dtype).requires_grad_()
    tk.from_voxels(leaf, level=0.0, n_samples=300).samples.points.sum().backward()
    assert leaf.grad.dtype == dtype
    exact = SPHERE.to(dtype).double().requires_grad_()
    tk.from_voxels(exact, level=0.0, n_samples=300).samples.points.sum().backward()
    torch.testing.assert_close(leaf.grad.double(), exact.grad, rtol=2e-2, atol=2e-3 * float(exact.grad.abs().max()))


def test_a_sphere_grows_as_its_values_rise() -> None:
    """With the values at 1 per unit of length, points move outward by what is added to all of them."""
    x, y, z = axes(24)
    leaf = (0.6 - (x * x + y * y + z * z).sqrt()).requires_grad_()
    shape = tk.from_voxels(leaf, level=0.0, spacing=2 / 23, origin=(-1, -1, -1), n_samples=500)
    outward = (shape.samples.points * shape.samples.normals.detach()).sum(-1).mean()
    area = shape.curvature(20).area.sum()
    (motion,) = torch.autograd.grad(outward, leaf, retain_graph=True)
    (growth,) = torch.autograd.grad(area, leaf)
    assert float(motion.sum()) == pytest.approx(1, abs=0.05)
    assert float(area.detach()) == pytest.approx(4 * math.pi * 0.6**2, rel=0.1)  # smoothing shrinks it
    assert float(growth.sum()) == pytest.approx(8 * math.pi * 0.6, rel=0.05)


@pytest.mark.parametrize("volume", [SPHERE > 0, (SPHERE > 0).int(), (SPHERE > 0).double()])
def test_volumes_that_need_no_gradient_have_none(volume: Tensor) -> None:
    assert not tk.from_voxels(volume, n_samples=100).samples.points.requires_grad


def test_slopes_are_finite_on_plateaus_and_for_infinite_values() -> None:
    plateau = torch.zeros(12, 12, 12, dtype=torch.float64)
    plateau[4:8, 4:8, 4:8] = 1.0
    infinite = torch.full((12, 12, 12), -math.inf)
    infinite[3:9, 3:9, 3:9] = math.inf
    infinite[4, 4, 4] = math.nan
    single = torch.full((5, 5, 5), -1.0)
    single[2, 2, 2] = 1e-20
    for volume in (plateau, infinite, single):
        leaf = volume.clone().requires_grad_()
        shape = tk.from_voxels(leaf, level=0.0, n_samples=200)
        local = shape.curvature(20)
        (local.gaussian.tanh() * local.area).sum().backward()
        assert leaf.grad.isfinite().all()


def test_samples_follow_a_volume_in_training() -> None:
    samples = tk.from_voxels(SPHERE, level=0.0, n_samples=300).samples
    far = torch.full((20, 3), 40.0, dtype=torch.float64)
    for shift in (0.02, 0.04):
        followed = tk.from_voxels(SPHERE + shift, level=0.0, starts=torch.cat((samples.points, far)).numpy()).samples
        assert followed.n_points == 300
        outward = ((followed.points - samples.points) * samples.normals).sum(-1)
        assert float(outward.min()) > 0
        samples = followed
    with pytest.raises(InputError, match="none of the 20 starts is within 2 of the volume's surface"):
        tk.from_voxels(SPHERE, level=0.0, starts=far).curvature()
    with pytest.raises(InputError, match=r"starts must be finite points \(N, 3\)"):
        tk.from_voxels(SPHERE, level=0.0, starts=torch.zeros(4, 2))


def test_the_samples_of_thin_solids_lie_on_the_surface() -> None:
    """One voxel thick: too thin for the filter, so they are sampled as they are, on the spline."""
    volume = torch.zeros(24, 24, 24)
    volume[4:20, 4:20, 12] = 1
    shape = tk.from_voxels(volume)
    assert float(gauss_bonnet(shape)) == pytest.approx(2, abs=0.3)
    assert float((shape.samples.points[:, 2] - 12).abs().max()) < 0.7
