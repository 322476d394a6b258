"""Filters of volumes: SciPy's values, and derivatives of all orders."""

from __future__ import annotations

import pytest
import torch
from scipy import ndimage
from torch import Tensor

from topokit.core.grid.filters import gaussian, spline_coefficients

VOLUME = torch.randn(9, 10, 12, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def smooth(values: Tensor) -> Tensor:
    return gaussian(values, 1.0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_values_are_those_of_scipy_in_the_own_type(dtype: torch.dtype) -> None:
    volume = VOLUME.to(dtype)
    for found, expected in (
        (smooth(volume), ndimage.gaussian_filter(volume.numpy(), 1.0, mode="mirror")),
        (spline_coefficients(volume), ndimage.spline_filter(volume.numpy(), 2, mode="mirror")),
    ):
        assert found.dtype == dtype
        torch.testing.assert_close(found, torch.from_numpy(expected).to(dtype))


@pytest.mark.parametrize("work", [smooth, spline_coefficients])
def test_the_backward_pass_is_the_adjoint(work) -> None:
    """Exactly also at the borders: <F v, g> = <v, Fᵀ g> for any v and g."""
    leaf = VOLUME.clone().requires_grad_()
    other = torch.randn(VOLUME.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    (adjoint,) = torch.autograd.grad(work(leaf), leaf, other)
    assert float((adjoint * VOLUME).sum()) == pytest.approx(float((other * work(VOLUME)).sum()), rel=1e-12)
    (twice,) = torch.autograd.grad(work(adjoint.requires_grad_()), adjoint, VOLUME)
    assert float((twice * other).sum()) == pytest.approx(float((VOLUME * work(other)).sum()), rel=1e-12)


@pytest.mark.parametrize("work", [smooth, spline_coefficients])
def test_second_and_forward_derivatives(work) -> None:
    leaf = VOLUME.clone().requires_grad_()
    checked = {"check_forward_ad": True, "fast_mode": True}
    assert torch.autograd.gradcheck(lambda values: work(values).square(), leaf, **checked)
    assert torch.autograd.gradgradcheck(lambda values: work(values).square(), leaf, fast_mode=True)
