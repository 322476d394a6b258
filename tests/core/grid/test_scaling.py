"""Fields of any size: signs stay, sizes become moderate, and nothing is rounded that need not be."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.core.grid.scaling import at_moderate_size


def box(scale: float) -> np.ndarray:
    values = np.random.default_rng(0).uniform(0.5, 1.5, (12, 12, 12))
    values[:] *= -1
    values[3:8, 3:8, 3:8] *= -1
    return values * scale


@pytest.mark.parametrize("exponent", [-1060, -1000, 90, 1022])
def test_answers_do_not_depend_on_the_size_of_values(exponent: int) -> None:
    usual, scaled = (tk.from_voxels(np.ldexp(box(1.0), power), level=0.0) for power in (0, exponent))
    assert scaled.report().euler == 2
    tolerance = 0.0 if exponent > -1000 else 1e-3  # fewer digits are left near the smallest number
    assert abs(float(scaled.gauss_bonnet(boundary=False)) - float(usual.gauss_bonnet(boundary=False))) <= tolerance


@pytest.mark.parametrize("scale", [1e-310, 1e300])
def test_pages_show_values_of_any_size(scale: float, tmp_path) -> None:
    tk.from_voxels(box(scale), level=0.0).save_html(tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 1000


def test_signs_stay_and_powers_of_two_are_exact() -> None:
    values = torch.tensor([0.0, 5e-324, -5e-324, 1.5, -3.0, 1e308, -1e308], dtype=torch.float64)
    found = at_moderate_size(values)
    assert found.float().isfinite().all()
    assert torch.equal(found.float().sign(), values.sign())
    assert found[4] / found[3] == -2.0
    assert (at_moderate_size(torch.zeros(2, 2)) == 0).all()


@pytest.mark.parametrize("largest", [1e-45, 1e-38, 1.0, 1e38])
def test_single_precision_is_kept_at_its_ends(largest: float) -> None:
    values = largest * torch.tensor([1.0, -0.5, 0.25, 0.0])
    found = at_moderate_size(values)
    assert found.dtype == torch.float32
    assert found.isfinite().all()
    assert torch.equal(found.sign(), values.sign())
    assert 0.1 < float(found.abs().max()) < 10


def test_slopes_are_those_of_the_power_of_two_and_vanish_beyond_the_range() -> None:
    values = torch.tensor([0.0, 3.0, -5.0, 1e40, 6.0], dtype=torch.float64, requires_grad=True)
    at_moderate_size(values).sum().backward()
    assert values.grad.tolist() == [0.125, 0.125, 0.125, 0.0, 0.125]
