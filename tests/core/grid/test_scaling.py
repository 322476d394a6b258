"""Fields in single precision: signs stay, sizes become moderate, and nothing is rounded that need not be."""

from __future__ import annotations

import numpy as np
import pytest

import topokit as tk
from topokit.core.grid.scaling import in_single_precision


def box(scale: float) -> np.ndarray:
    values = np.random.default_rng(0).uniform(0.5, 1.5, (12, 12, 12))
    values[:] *= -1
    values[3:8, 3:8, 3:8] *= -1
    return values * scale


@pytest.mark.parametrize("exponent", [-1060, -1000, -400, -100, -3, 0, 7, 90, 400, 1000, 1022])
def test_answers_do_not_depend_on_the_size_of_values(exponent: int) -> None:
    usual, scaled = (tk.from_voxels(np.ldexp(box(1.0), power), level=0.0) for power in (0, exponent))
    assert scaled.report().euler == 2
    tolerance = 0.0 if exponent > -1000 else 1e-3  # fewer digits are left near the smallest number
    assert abs(float(scaled.gauss_bonnet(boundary=False)) - float(usual.gauss_bonnet(boundary=False))) <= tolerance


@pytest.mark.parametrize("scale", [1e-310, 1e-300, 1e-20, 1e20, 1e300])
def test_pages_show_values_of_any_size(scale: float, tmp_path) -> None:
    tk.from_voxels(box(scale), level=0.0).save_html(tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 1000


def test_signs_stay_and_powers_of_two_are_exact() -> None:
    values = np.array([0.0, 5e-324, -5e-324, 1.5, -3.0, 1e308, -1e308])
    found = in_single_precision(values)
    assert found.dtype == np.float32
    assert np.isfinite(found).all()
    assert (np.sign(found) == np.sign(values)).all()
    assert found[4] / found[3] == -2.0
    assert (in_single_precision(np.zeros((2, 2))) == 0).all()
