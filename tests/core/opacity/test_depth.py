"""The least optical depth from outside."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from topokit.core.opacity.depth import least_depth


def box(wall: float = 1.0) -> Tensor:
    """A cube of 21 voxels with a wall of two voxels that absorb."""
    values = torch.zeros(21, 21, 21, dtype=torch.float64)
    values[4:17, 4:17, 4:17] = wall
    values[6:15, 6:15, 6:15] = 0.0
    return values


def test_a_wall_absorbs_what_lies_in_it() -> None:
    depth = least_depth(box(3.0), 0.5)
    assert float(depth[0, 0, 0]) == 0
    assert float(depth[10, 10, 10]) == pytest.approx(3.0 * 0.5 * 1.5)  # half of the first step is that to the wall


def test_light_finds_the_clearest_way_around_corners() -> None:
    values = box()
    values[4:6, 7, 7] = 0.0  # a hole, far from the middle
    depth = least_depth(values, 1.0)
    assert float(depth[10, 10, 10]) < 1e-3
    assert float(depth[14, 14, 14]) < 1e-3  # where no straight ray through the hole leads


def test_the_outermost_layer_is_air() -> None:
    assert float(least_depth(torch.ones(5, 5, 5, dtype=torch.float64), 1.0)[0].max()) == 0
    assert float(least_depth(torch.zeros(5, 5, 5, dtype=torch.float64), 1.0).max()) == 0


def test_its_gradient_is_that_of_the_paths() -> None:
    generator = torch.Generator().manual_seed(0)
    given = torch.rand(8, 7, 9, generator=generator, dtype=torch.float64)
    weights = torch.randn(given.shape, generator=generator, dtype=torch.float64)
    values = given.clone().requires_grad_()
    (least_depth(values, 0.3) * weights).sum().backward()
    step, found = 1e-7, np.zeros(given.shape)
    for place in np.ndindex(given.shape):
        moved = [given.clone(), given.clone()]
        moved[0][place] += step
        moved[1][place] -= step
        high, low = (float((least_depth(one, 0.3) * weights).sum()) for one in moved)
        found[place] = (high - low) / (2 * step)
    np.testing.assert_allclose(values.grad.numpy(), found, atol=1e-6)


def test_more_extinction_never_lets_more_light_in() -> None:
    generator = torch.Generator().manual_seed(1)
    less = torch.rand(9, 9, 9, generator=generator, dtype=torch.float64)
    more = less + torch.rand(9, 9, 9, generator=generator, dtype=torch.float64)
    assert bool((least_depth(more, 1.0) >= least_depth(less, 1.0) - 1e-12).all())
