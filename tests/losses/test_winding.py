"""The winding-number loss: where it is small, its gradient, and that it finds the signs of normals."""

from __future__ import annotations

import pytest
import torch
from torch.autograd import gradcheck

import topokit as tk
from topokit.testing import sphere_samples, torus_samples


def test_only_outward_normals_have_a_small_loss() -> None:
    known = torus_samples(1000)
    generator = torch.Generator().manual_seed(5)
    random = torch.randn(known.points.shape, generator=generator, dtype=torch.float64)
    loss = tk.losses.WindingLoss(resolution=40)
    right, inward, confused = (float(loss(known.points, n)) for n in (known.normals, -known.normals, random))
    assert right < 0.15
    assert confused > 1
    assert inward > 2
    half = torch.where(known.points[:, :1] < 0, -1.0, 1.0) * known.normals
    assert float(loss(known.points, half)) > 3 * right
    longer = float(loss(known.points * 100, known.normals * 7))
    assert longer == pytest.approx(right, rel=0.05)


def test_random_normals_become_outward() -> None:
    """As in docs/paper-tables.md: smoothing falls from four spacings to one."""
    known = sphere_samples(400)
    normals = torch.randn(400, 3, generator=torch.Generator().manual_seed(5), dtype=torch.float64).requires_grad_()
    loss = tk.losses.WindingLoss(resolution=32)
    optimizer = torch.optim.Adam([normals], lr=0.3)
    for step in range(80):
        optimizer.zero_grad()
        loss(known.points, normals, smoothing=max(1.0, 4 - step / 16)).backward()
        optimizer.step()
    cosine = torch.nn.functional.cosine_similarity(normals.detach(), known.normals, dim=1)
    assert float((cosine > 0.9).double().mean()) > 0.98


def test_gradient_in_normals_areas_and_points() -> None:
    known = sphere_samples(20)
    areas = torch.full((20,), known.area / 20, dtype=torch.float64).requires_grad_()
    normals = known.normals.clone().requires_grad_()
    loss = tk.losses.WindingLoss(resolution=16)
    assert gradcheck(lambda n, a: loss(known.points, n, a), (normals, areas), atol=1e-4)
    points = known.points.clone().requires_grad_()
    loss(points, known.normals).backward()
    assert points.grad is not None
    assert points.grad.isfinite().all()
    assert float(points.grad.norm()) > 0


def test_functional_form_and_errors() -> None:
    known = sphere_samples(200)
    module = tk.losses.WindingLoss(balance=0.5, alignment=2.0, resolution=32)
    value = tk.losses.winding_loss(known.points, known.normals, balance=0.5, alignment=2.0, resolution=32)
    assert torch.equal(value, module(known.points, known.normals))
    with pytest.raises(tk.InputError, match="must both be"):
        module(known.points, known.normals[:-1])
    with pytest.raises(tk.InputError, match="smoothing must be"):
        module(known.points, known.normals, smoothing=0.0)
    with pytest.raises(tk.InputError, match="balance must be a finite number"):
        tk.losses.WindingLoss(balance=float("nan"))
