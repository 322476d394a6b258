"""The topology loss and the Euler loss on plain fields: values, gradients, degenerate input."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest
import torch
from analytic_fields import ball, grid, torus, union
from torch import Tensor

import topokit as tk
from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.euler import smoothed_euler
from topokit.core.grid.tau import default_tau
from topokit.errors import InputError

Loss = Callable[..., Tensor]

DOUBLE = torch.float64
P = grid(20)
TORUS = torus(P, 0.5, 0.25)
BALL = ball(P, 0.5)
TORUS_AND_BLOB = union(TORUS, ball(P, 0.15, (0.75, 0.75, 0.75)))
OUT_OF_REACH = pytest.mark.filterwarnings("ignore:no solid with the Betti numbers:UserWarning")


def euler(field: Tensor, tau: float | None = None, **options: Any) -> Tensor:
    """The Euler loss with the χ of a ball."""
    return tk.euler_loss(field, 2.0, tau, **options)


def topology(field: Tensor, tau: float | None = None, genus: int | Sequence[int] = 0, **options: Any) -> Tensor:
    """The topology loss with the Betti numbers of a ball."""
    return tk.topology_loss(field, genus, tau, **options)


both_losses = pytest.mark.parametrize("loss", [euler, topology])


def value_and_slope(loss: Loss, field: Tensor, tau: float | None = None, **options: Any) -> tuple[Tensor, Tensor]:
    """The loss, and its gradient with respect to the field."""
    leaf = field.detach().clone().requires_grad_()
    value = loss(leaf, tau, **options)
    (slope,) = torch.autograd.grad(value.sum(), leaf)
    return value.detach(), slope


# values


def test_the_euler_loss_is_the_squared_difference() -> None:
    chi = smoothed_euler(TORUS, 0.05)
    assert euler(TORUS, 0.05) == (chi - 2).square()
    assert euler(TORUS + 0.3, 0.05, level=0.3) == pytest.approx(float(chi - 2) ** 2)
    for connectivity in (6, 26):
        expected = (smoothed_euler(TORUS_AND_BLOB, 0.2, 0, connectivity) - 2).square()
        assert euler(TORUS_AND_BLOB, 0.2, connectivity=connectivity) == expected


def test_the_topology_loss_is_small_for_the_right_topology_and_large_for_a_wrong_one() -> None:
    shell = torch.minimum(BALL, -ball(P, 0.25))
    goals: list[dict[str, int]] = [{"genus": 0}, {"genus": 1}, {"genus": 0, "cavities": 1}]
    for field, right, reachable in ((BALL, 0, [0]), (TORUS, 1, [0, 1]), (shell, 2, [0, 2])):
        for number in reachable:
            loss = tk.topology_loss(field, tau=0.01, **goals[number])
            assert loss < 2e-5 if number == right else loss > 2e-4, (right, number, loss)


def test_the_genus_of_each_component_is_asked_for_in_order_of_size() -> None:
    assert topology(TORUS_AND_BLOB, 0.01, (1, 0)) < 1e-4
    assert topology(TORUS_AND_BLOB, 0.01, 1, components=2) < 1e-4
    assert topology(TORUS_AND_BLOB, 0.01, (0, 0)) > 1e-3


def test_the_euler_loss_takes_a_torus_and_a_blob_for_a_ball_and_the_topology_loss_does_not() -> None:
    """χ = 0 + 2 is that of a ball."""
    value, slope = value_and_slope(euler, TORUS_AND_BLOB, 0.01)
    assert value < 1e-6
    assert slope.abs().max() < 1e-4
    value, slope = value_and_slope(topology, TORUS_AND_BLOB, 0.01)
    assert value > 1e-3
    pushed = torch.where(slope.abs() > 0.1 * slope.abs().max(), -slope.sign(), TORUS_AND_BLOB)
    assert betti_numbers(TORUS_AND_BLOB).tolist() == [2, 1, 0]
    assert betti_numbers(pushed).tolist() == [1, 0, 0]
    assert (pushed[-4:, -4:, -4:] < 0).all()


@pytest.mark.parametrize("change", ["add", "remove"])
def test_with_one_way_change_a_torus_gets_a_membrane_or_a_cut(change: str) -> None:
    _, slope = value_and_slope(topology, TORUS, 0.02, change=change)
    pushed = torch.where(slope.abs() > 0.5 * slope.abs().max(), -slope.sign(), TORUS)
    assert betti_numbers(pushed).tolist() == [1, 0, 0]
    changed = (pushed > 0) != (TORUS > 0)
    distance = P[changed][:, :2].norm(dim=1)  # to the axis of the torus
    assert (distance < 0.3).all() if change == "add" else (distance > 0.2).all()
    assert (TORUS[changed] < 0).all() if change == "add" else (TORUS[changed] > 0).all()


def test_losses_are_combined_by_addition() -> None:
    leaf = TORUS.clone().requires_grad_()
    (slope,) = torch.autograd.grad(topology(leaf, 0.05) + 3 * euler(leaf, 0.05), leaf)
    expected = value_and_slope(topology, TORUS, 0.05)[1] + 3 * value_and_slope(euler, TORUS, 0.05)[1]
    torch.testing.assert_close(slope, expected)


# gradients


@pytest.mark.parametrize("connectivity", [6, 26])
def test_gradcheck_of_the_euler_loss(connectivity: int, generator: torch.Generator) -> None:
    field = torch.randn(4, 3, 5, generator=generator, dtype=DOUBLE, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: euler(x, 0.7, connectivity=connectivity), field)


@pytest.mark.parametrize("options", [{}, {"change": "add"}, {"genus": (1, 0)}], ids=str)
def test_gradcheck_of_the_topology_loss(options: dict[str, Any], generator: torch.Generator) -> None:
    p = grid(8)
    field = torch.maximum(torus(p, 0.55, 0.3), ball(p, 0.4, (0.9, 0.9, 0.9)) - 0.1)
    field = (field + 0.03 * torch.randn(8, 8, 8, generator=generator, dtype=DOUBLE)).requires_grad_()
    value, slope = value_and_slope(topology, field, 0.1, **options)
    assert value > 0.01
    assert slope.count_nonzero() > 5
    assert torch.autograd.gradcheck(lambda x: topology(x, 0.1, **options), field, fast_mode=True)


@OUT_OF_REACH
@pytest.mark.parametrize(
    ("loss", "options"),
    [
        pytest.param(euler, {}, id="euler"),
        pytest.param(topology, {"genus": (0, 0)}, id="two components"),
        pytest.param(topology, {}, id="topology", marks=pytest.mark.long),
        pytest.param(topology, {"change": "add"}, id="add", marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize(
    "dtype",
    [
        torch.float32,
        torch.float16,
        pytest.param(DOUBLE, marks=pytest.mark.long),
        pytest.param(torch.bfloat16, marks=pytest.mark.long),
    ],
    ids=str,
)
def test_loss_and_gradient_are_finite_at_degenerate_fields(
    loss: Loss, options: dict[str, Any], dtype: torch.dtype, generator: torch.Generator
) -> None:
    noise = torch.randn(5, 4, 6, generator=generator, dtype=DOUBLE)
    infinite = noise.clone()
    infinite[1:3, 1, 2:4], infinite[3, 3, :] = math.inf, -math.inf
    fields = [torch.full((3, 4, 3), value, dtype=DOUBLE) for value in (0.0, 1.0, -1.0, math.inf, -math.inf, 3e4)]
    fields += [noise, noise.round(), infinite, noise.sign(), 1e-6 * noise, noise.new_ones(1, 1, 1), -noise[:1, :1]]
    for field in fields:
        for tau in (1e-6 if dtype.itemsize > 2 else 2e-3, 1e3):
            value, slope = value_and_slope(loss, field.to(dtype), tau, **options)
            assert value.isfinite()
            assert slope.isfinite().all(), (tau, field)
            assert value.dtype == (DOUBLE if dtype == DOUBLE else torch.float32)
            assert slope.dtype == dtype


@pytest.mark.parametrize("scale", [1e-20, 1e30, 1e100])
def test_huge_and_tiny_values(scale: float) -> None:
    """The Euler loss has no unit; the topology loss has that of a squared error."""
    for loss, unit in ((euler, 1.0), (topology, scale**2)):
        expected, slope = value_and_slope(loss, TORUS)
        value, scaled = value_and_slope(loss, scale * TORUS)
        torch.testing.assert_close(value / unit, expected)
        torch.testing.assert_close(scaled / unit * scale, slope)


def test_nan_gives_nan_in_the_euler_loss_and_is_refused_by_the_topology_loss() -> None:
    broken = TORUS.clone()
    broken[1, 2, 3] = math.nan
    for tau in (0.1, None):
        assert euler(broken, tau).isnan()
        with pytest.raises(InputError, match=r"NaN at 1 of \d+ grid points, the first at index \(1, 2, 3\)"):
            topology(broken, tau)
    with pytest.raises(InputError, match=r"of batch item 1 is NaN .* put -inf"):
        topology(torch.stack((TORUS, broken)), 0.1)
    value, slope = value_and_slope(topology, broken.masked_fill(broken.isnan(), -math.inf), 0.1, change="add")
    assert value == value_and_slope(topology, TORUS, 0.1, change="add")[0]
    assert slope[1, 2, 3] == 0


# forms of input


@both_losses
def test_a_batch_equals_its_items(loss: Loss) -> None:
    fields = torch.stack([TORUS, BALL, TORUS_AND_BLOB, -TORUS]).reshape(2, 2, *TORUS.shape)
    values, slopes = value_and_slope(loss, fields, 0.05, reduction="none")
    assert values.shape == (2, 2)
    for item in ((i, j) for i in range(2) for j in range(2)):
        value, slope = value_and_slope(loss, fields[item], 0.05)
        torch.testing.assert_close(values[item], value)
        torch.testing.assert_close(slopes[item], slope)
    for reduction, expected in (("mean", values.mean()), ("sum", values.sum())):
        torch.testing.assert_close(loss(fields, 0.05, reduction=reduction), expected)


@both_losses
def test_strides_do_not_matter_and_the_field_is_not_modified(loss: Loss) -> None:
    field = torus(grid(16), 0.5, 0.25) + 0.01 * grid(16)[..., 0]
    turned = field.permute(2, 0, 1)
    before = field.clone()
    assert loss(turned, 0.05) == loss(turned.contiguous(), 0.05)
    cut = field[2:-2, 3:, ::2]  # touches the border
    torch.testing.assert_close(loss(cut, 0.05), loss(cut.clone(), 0.05))
    assert field.equal(before)
    assert not loss(field, 0.05).requires_grad


@both_losses
def test_tau_is_half_the_typical_change_over_a_cell_by_default(loss: Loss) -> None:
    slab = 0.4 - P[..., 0]  # changes by 2 / 19 over each cell
    assert default_tau(slab) == pytest.approx(1 / 19)
    assert loss(slab) == loss(slab, default_tau(slab))
    batch = torch.stack([TORUS, 3 * TORUS])
    unit = torch.tensor([1.0, 9.0 if loss is topology else 1.0], dtype=DOUBLE)
    torch.testing.assert_close(loss(batch, reduction="none"), loss(TORUS) * unit)
    for left in (torch.ones(3, 3, 3), torch.zeros(3, 3, 3), TORUS + 5, -torch.rand(4, 4, 4)):
        assert loss(left).isfinite()


def test_the_fields_of_shapes_have_the_same_default_tau() -> None:
    shape = tk.from_voxels(TORUS, level=0.0)
    torch.testing.assert_close(shape.smoothed_euler(), smoothed_euler(TORUS, default_tau(TORUS)))
    torch.testing.assert_close(tk.euler_loss(shape, 2.0), euler(TORUS))


@both_losses
@pytest.mark.parametrize("half", [torch.float16, torch.bfloat16])
def test_half_precision_and_autocast_keep_single_precision_inside(loss: Loss, half: torch.dtype) -> None:
    field = TORUS.to(half)
    expected, steep = value_and_slope(loss, field.float(), 0.05)
    value, slope = value_and_slope(loss, field, 0.05)
    assert value == expected
    torch.testing.assert_close(slope, steep.to(half))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert value_and_slope(loss, field.float(), 0.05)[0] == expected


@pytest.mark.parametrize(
    ("module", "function", "whole"),
    [
        pytest.param(tk.EulerLoss(2.0), euler, True, id="euler"),
        pytest.param(tk.TopologyLoss(0), topology, False, id="topology", marks=pytest.mark.long),
    ],
)
def test_the_euler_loss_compiles_whole_and_the_topology_loss_in_parts(
    module: torch.nn.Module, function: Loss, whole: bool
) -> None:
    torch._dynamo.reset()
    fields = torch.stack([TORUS, BALL]).float()
    compiled = torch.compile(module, fullgraph=whole, backend="aot_eager")
    for tau in (0.1, 0.05):
        leaf = fields.clone().requires_grad_()
        value = compiled(leaf, tau)
        expected, slope = value_and_slope(function, fields, tau)
        torch.testing.assert_close(value.detach(), expected)
        torch.testing.assert_close(torch.autograd.grad(value, leaf)[0], slope)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@both_losses
@pytest.mark.parametrize("tau", [0.05, None])
def test_cuda_agrees(loss: Loss, tau: float | None) -> None:
    value, slope = value_and_slope(loss, TORUS_AND_BLOB, tau)
    on_gpu, slope_on_gpu = value_and_slope(loss, TORUS_AND_BLOB.cuda(), tau)
    assert on_gpu.is_cuda
    torch.testing.assert_close(on_gpu.cpu(), value)
    torch.testing.assert_close(slope_on_gpu.cpu(), slope)


# the modules


def test_the_modules_equal_the_functions() -> None:
    for module, function in ((tk.EulerLoss(2.0), euler), (tk.TopologyLoss(genus=0), topology)):
        assert module(TORUS, 0.05) == module(TORUS, tau=0.05) == function(TORUS, 0.05)
        assert not list(module.parameters())
