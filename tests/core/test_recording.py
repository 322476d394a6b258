"""What CUDA graphs need: operations that are recorded with one input are right for any other of the same shape.

Recording runs on the CPU, as `torch.fx` does it: a number that were read, a branch that were taken or a shape that were
chosen by the values of the first input would be wrong for the second, or stop the recording. Nothing here has been
captured on a GPU.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from analytic_fields import grid, torus
from torch import Tensor
from torch.fx.experimental.proxy_tensor import make_fx

import topokit as tk
from topokit.core.grid.field import GridField
from topokit.core.neighbors.device import MOST_FOR_ALL_PAIRS
from topokit.testing import as_on_accelerator, ellipsoid_samples, sphere_samples, torus_samples

Inputs = tuple[Tensor, ...]
LENGTHS = torch.tensor([120, 90])


def clouds(*makes: Callable[..., tk.testing.AnalyticSamples]) -> Inputs:
    known = [make(120, generator=torch.Generator().manual_seed(7)) for make in makes]
    return torch.stack([one.points for one in known]), torch.stack([one.normals for one in known])


CLOUDS = clouds(torus_samples, sphere_samples), clouds(ellipsoid_samples, torus_samples)
FIELDS = (torus(grid(12), 0.5, 0.25),), (torus(grid(12), 0.6, 0.15) + 0.01 * grid(12)[..., 0].sin(),)
Case = tuple[tuple[Inputs, Inputs], Callable[..., Tensor]]
VALUES: dict[str, Case] = {
    "euler": (CLOUDS, lambda p, n: tk.from_points(p, n).gauss_bonnet(20, boundary=False)),
    "without normals": (CLOUDS, lambda p, n: tk.from_points(p).gauss_bonnet(20, boundary=False)),
    "of different size": (CLOUDS, lambda p, n: tk.from_points(p, n, lengths=LENGTHS).gauss_bonnet(20, boundary=False)),
    "curvature": (CLOUDS, lambda p, n: tk.from_points(p).curvature(12).mean.square()),
    "refined": (CLOUDS, lambda p, n: tk.from_points(p, n).refined_euler(1.0, 20, max_steps=1, boundary=False)),
    "smoothed": (FIELDS, lambda f: GridField(f).smoothed_euler(0.05)),
    "Euler loss": (FIELDS, lambda f: tk.euler_loss(f, 2.0, 0.05)),
}
LONG = ("euler", "curvature", "refined")  # operations of the others, and steps that take long to record


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in VALUES]
)
def test_operations_recorded_with_one_input_are_right_for_another(name: str) -> None:
    (first, second), value_of = VALUES[name]

    def step(*inputs: Tensor) -> Inputs:
        leaf = inputs[0].detach().requires_grad_()
        value = value_of(leaf, *inputs[1:])
        return value.detach(), torch.autograd.grad(value.sum(), leaf)[0]

    with as_on_accelerator():
        recorded = make_fx(step)(*first)
        expected = step(*second)
        found = recorded(*second)
    for here, there in zip(found, expected, strict=True):
        assert torch.equal(here, there)
    assert expected[1].abs().max() > 0


def test_no_shape_depends_on_values_up_to_the_limit_of_all_pairs() -> None:
    """Tensors on the device "meta" have no values: a shape that depended on them could not be known."""

    def euler_of(n_points: int) -> Tensor:
        points = torch.empty(1, n_points, 3, device="meta", requires_grad=True)
        value = tk.from_points(points).gauss_bonnet(20, boundary=False)
        value.sum().backward()
        return value

    assert euler_of(MOST_FOR_ALL_PAIRS).shape == (1,)
    with pytest.raises((RuntimeError, NotImplementedError), match=r"(?i)meta"):
        euler_of(MOST_FOR_ALL_PAIRS + 1)
