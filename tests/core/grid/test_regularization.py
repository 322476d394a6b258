"""Samples regularized by their winding number: noise goes, normals and curvature with few neighbors improve."""

from __future__ import annotations

import pytest
import torch

import topokit as tk
from topokit.testing import torus_samples


def test_noise_is_taken_out_and_twenty_neighbors_suffice() -> None:
    known = torus_samples(5000)
    generator = torch.Generator().manual_seed(1)
    points = known.points + 0.028 * torch.randn(5000, 3, generator=generator, dtype=torch.float64)
    plain = tk.from_points(points, known.normals)
    smooth = tk.from_points(points, known.normals, regularize=True)

    def distance(shape: tk.Shape) -> float:
        x, y, z = shape.samples.points.unbind(-1)
        return float((torch.hypot(torch.hypot(x, y) - 1, z) - 0.4).square().mean().sqrt())

    def error(shape: tk.Shape) -> float:
        found = shape.curvature(20).gaussian
        return float((found - known.gaussian).abs().median() / known.gaussian.abs().median())

    assert distance(smooth) < 0.5 * distance(plain)
    assert smooth.samples.oriented
    assert error(smooth) < 0.2
    assert error(smooth) < error(tk.from_points(points)) / 3


def test_gradients_reach_the_points_and_wrong_input_is_refused() -> None:
    known = torus_samples(1000)
    points = known.points.clone().requires_grad_()
    tk.from_points(points, known.normals).regularized().samples.points.square().sum().backward()
    assert points.grad is not None
    assert points.grad.isfinite().all()
    batch = tk.from_points(torch.stack((known.points, known.points)), torch.stack((known.normals, known.normals)))
    with pytest.raises(tk.InputError, match="an item at a time"):
        batch.regularized()
