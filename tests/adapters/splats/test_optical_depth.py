"""The optical depth of splats: a field that opacities are trained with, and the second witness of their reports."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from splat_writers import torus_scene
from torch import Tensor

import topokit as tk
from topokit.errors import InputError


def torus(opacity: float = 0.9) -> tk.GaussianSplats:
    scene = torus_scene(600)
    means, scales, quaternions = (torch.from_numpy(np.ascontiguousarray(part)).double() for part in scene[:3])
    return tk.GaussianSplats(means, 1.5 * scales, quaternions, torch.full((600,), opacity, dtype=torch.float64))


def test_it_is_zero_outside_and_grows_to_the_walls_depth_inside() -> None:
    found = torus().optical_depth()
    place = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.9]])  # in the tube, in the hole, above
    x, y, z = ((place - torch.tensor(found.origin)) / found.spacing[0]).round().long().T
    inside, hole, above = found.values[x, y, z].tolist()
    assert inside > math.log(2)
    assert max(hole, above) < 0.1
    solid = tk.from_voxels(found.values, level=math.log(2), spacing=found.spacing, origin=found.origin)
    assert solid.betti().solid == (1, 1, 0)


def test_a_given_step_is_that_of_the_grid() -> None:
    found = torus().optical_depth(step=0.1)
    assert found.spacing == (0.1, 0.1, 0.1)
    assert float(found.values[0].max()) == 0


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan, math.inf])
def test_a_step_must_be_a_length(step: float) -> None:
    with pytest.raises(InputError, match="positive length in units of the means"):
        torus().optical_depth(step)
    with pytest.raises(InputError, match="at least two"):
        torus()[:1].optical_depth()


def mean_depth(parts: list[Tensor]) -> Tensor:
    values = tk.GaussianSplats(*parts).optical_depth(step=0.1).values
    return values[values.shape[0] // 2].square().mean()


def test_gradients_reach_everything_a_splat_has() -> None:
    start = torus(0.7)[::10]
    given = [start.means, start.scales, start.quaternions, start.opacities]
    parts = [part.clone().requires_grad_() for part in given]
    mean_depth(parts).backward()
    assert all(bool(part.grad.isfinite().all()) and float(part.grad.abs().max()) > 0 for part in parts)
    direction = torch.randn(60, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    high, low = (float(mean_depth([*given[:3], given[3] + step * direction])) for step in (1e-6, -1e-6))
    assert (high - low) / 2e-6 == pytest.approx(float((parts[3].grad * direction).sum()), rel=1e-4)


def test_opaque_splats_have_no_slope_by_opacity_as_in_renderers() -> None:
    opacities = torch.ones(600, dtype=torch.float64, requires_grad=True)
    start = torus()
    found = tk.GaussianSplats(start.means, start.scales, start.quaternions, opacities).optical_depth(step=0.1)
    found.values.sum().backward()
    assert float(opacities.grad.abs().max()) == 0


def test_a_plane_that_everything_lies_on_surrounds_nothing() -> None:
    places = torch.rand(2_000, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([4.0, 4.0, 0.0])
    flat = torch.tensor([0.1, 0.1, 0.001]).expand(2_000, 3)
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0]).expand(2_000, 4)
    kept = tk.GaussianSplats(places, flat, upright, torch.ones(2_000)).object()
    assert len(kept) == 2_000
