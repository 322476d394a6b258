"""The Euler loss on plain fields: values, gradients, degenerate input, and what it refuses."""

from __future__ import annotations

import copy
import math

import pytest
import torch
from analytic_fields import ball, grid, torus, union
from torch import Tensor

import topokit as tk
from topokit.core.grid.components import betti_numbers
from topokit.core.grid.euler import smoothed_euler
from topokit.errors import InputError

DOUBLE = torch.float64
P = grid(20)
TORUS = torus(P, 0.5, 0.25)
BALL = ball(P, 0.5)
TORUS_AND_BLOB = union(TORUS, ball(P, 0.15, (0.75, 0.75, 0.75)))
ALONE = {"components": None}
SILENT = pytest.mark.filterwarnings("ignore:no movement of the level:UserWarning")


def slope(field: Tensor, *arguments: float, **options: object) -> tuple[Tensor, Tensor]:
    """The loss, and its gradient with respect to the field."""
    leaf = field.detach().clone().requires_grad_()
    loss = tk.euler_loss(leaf, *arguments, **options)
    (gradient,) = torch.autograd.grad(loss.sum(), leaf)
    return loss.detach(), gradient


# what the numbers mean


def test_the_loss_is_the_squared_difference():
    chi = smoothed_euler(TORUS, 0.05)
    assert tk.euler_loss(TORUS, 2.0, 0.05, **ALONE) == (chi - 2).square()
    assert tk.euler_loss(TORUS + 0.3, 2.0, 0.05, level=0.3, **ALONE) == pytest.approx(float(chi - 2) ** 2)
    guarded, both = (tk.euler_loss(TORUS, 2.0, 0.05, euler_weight=weight) for weight in (0.0, 3.0))
    assert both - guarded == pytest.approx(3 * float(chi - 2) ** 2)
    assert tk.euler_loss(TORUS, 2.0, 0.05, connectivity=26, **ALONE) == (smoothed_euler(TORUS, 0.05, 0, 26) - 2) ** 2


def test_right_topologies_cost_nothing_and_wrong_ones_much():
    shell = torch.minimum(BALL, -ball(P, 0.25))
    goals = [{"genus": 0}, {"genus": 1}, {"genus": 0, "cavities": 1}]
    for field, right, reachable in ((BALL, 0, [0]), (TORUS, 1, [0, 1]), (shell, 2, [0, 2])):
        for number in reachable:
            loss = tk.euler_loss(field, tau=0.01, **goals[number])
            assert loss < 0.1 if number == right else loss > 3.5, (right, number)


def test_target_and_genus_say_the_same():
    assert tk.euler_loss(TORUS, 2.0, 0.1) == tk.euler_loss(TORUS, genus=0, tau=0.1)
    assert tk.euler_loss(TORUS, 4.0, 0.1, cavities=1) == tk.euler_loss(TORUS, genus=0, cavities=1, tau=0.1)
    assert tk.euler_loss(TORUS_AND_BLOB, (0.0, 2.0), 0.1) == tk.euler_loss(TORUS_AND_BLOB, genus=(1, 0), tau=0.1)


def test_a_torus_and_a_blob_are_no_ball():
    """χ = 0 + 2 is that of a ball: the pitfall of χ alone. The guard is not deceived."""
    loss, gradient = slope(TORUS_AND_BLOB, 2.0, 0.01, **ALONE)
    assert loss < 1e-6
    assert gradient.abs().max() < 1e-4
    loss, gradient = slope(TORUS_AND_BLOB, 2.0, 0.01)
    assert loss > 1
    obeyed = torch.where(gradient.abs() > 0.01, -gradient.sign(), TORUS_AND_BLOB)
    assert betti_numbers(TORUS_AND_BLOB).tolist() == [2, 1, 0]
    assert betti_numbers(obeyed).tolist() == [1, 0, 0]
    assert (obeyed[-4:, -4:, -4:] < 0).all()


@pytest.mark.parametrize("change", ["add", "remove"])
def test_a_push_one_way_is_the_membrane_or_the_cut(change):
    _, gradient = slope(TORUS, genus=0, tau=0.02, change=change)
    obeyed = torch.where(gradient.abs() > 0.1, -gradient.sign(), TORUS)
    assert betti_numbers(obeyed).tolist() == [1, 0, 0]
    changed = (obeyed > 0) != (TORUS > 0)
    distance = P[changed][:, :2].norm(dim=1)  # to the axis of the torus
    assert (distance < 0.3).all() if change == "add" else (distance > 0.2).all()
    assert (TORUS[changed] < 0).all() if change == "add" else (TORUS[changed] > 0).all()


# gradients


def test_gradcheck_of_chi_alone(generator):
    field = torch.randn(4, 3, 5, generator=generator, dtype=DOUBLE, requires_grad=True)
    for connectivity in (6, 26):
        assert torch.autograd.gradcheck(
            lambda x, c=connectivity: tk.euler_loss(x, 2.0, 0.7, connectivity=c, **ALONE), field
        )


@pytest.mark.parametrize(
    "options", [{"target": 2.0}, {"target": 2.0, "change": "add"}, {"target": (0.0, 2.0)}], ids=str
)
def test_gradcheck_with_the_guard(options, generator):
    p = grid(8)
    field = torch.maximum(torus(p, 0.55, 0.3), ball(p, 0.4, (0.9, 0.9, 0.9)) - 0.1)
    field = (field + 0.03 * torch.randn(8, 8, 8, generator=generator, dtype=DOUBLE)).requires_grad_()
    loss, gradient = slope(field, tau=0.3, **options)
    assert loss > 0.01
    assert gradient.count_nonzero() > 10
    assert torch.autograd.gradcheck(lambda x: tk.euler_loss(x, tau=0.3, **options), field, fast_mode=True)


@SILENT
@pytest.mark.parametrize("options", [ALONE, {}, {"change": "add"}, {"target": (2.0, 2.0)}], ids=str)
@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE, torch.bfloat16, torch.float16])
def test_loss_and_gradient_are_finite_at_degenerate_fields(options, dtype, generator):
    noise = torch.randn(5, 4, 6, generator=generator, dtype=DOUBLE)
    infinite = noise.clone()
    infinite[1:3, 1, 2:4], infinite[3, 3, :] = math.inf, -math.inf
    fields = [torch.full((3, 4, 3), value, dtype=DOUBLE) for value in (0.0, 1.0, -1.0, math.inf, -math.inf, 3e4)]
    fields += [noise, noise.round(), infinite, noise.sign(), 1e-6 * noise, noise.new_ones(1, 1, 1), -noise[:1, :1]]
    options = {"target": 2.0, **options}
    for field in fields:
        for tau in (1e-6 if dtype.itemsize > 2 else 2e-3, 0.3, 1e3):
            loss, gradient = slope(field.to(dtype), tau=tau, **options)
            assert loss.isfinite()
            assert gradient.isfinite().all(), (tau, field)
            assert loss.dtype == (DOUBLE if dtype == DOUBLE else torch.float32)
            assert gradient.dtype == dtype


@SILENT
def test_huge_and_tiny_values():
    for scale in (1e-40, 1e-30, 1e30, 1e200):
        for options in (ALONE, {}):
            loss, gradient = slope(scale * TORUS, 2.0, **options)
            assert loss.isfinite()
            assert gradient.isfinite().all()


def test_nan_gives_nan_but_is_background_to_the_guard():
    broken = TORUS.clone()
    broken[1, 1, 1] = math.nan
    for options in (ALONE, {"euler_weight": 1.0}):
        for tau in (0.1, None):
            assert tk.euler_loss(broken, 2.0, tau, **options).isnan()
    loss, gradient = slope(broken, 2.0, 0.1, change="add")
    assert loss == slope(TORUS, 2.0, 0.1, change="add")[0]
    assert gradient[1, 1, 1] == 0


# forms of input


@pytest.mark.parametrize("options", [ALONE, {}])
def test_a_batch_equals_its_items(options, generator):
    fields = torch.stack([TORUS, BALL, TORUS_AND_BLOB, TORUS + 0.02, -TORUS, TORUS.roll(2, 0)]).reshape(
        2, 3, *TORUS.shape
    )
    losses, gradients = slope(fields, 2.0, 0.05, reduction="none", **options)
    assert losses.shape == (2, 3)
    for item in ((i, j) for i in range(2) for j in range(3)):
        loss, gradient = slope(fields[item], 2.0, 0.05, **options)
        torch.testing.assert_close(losses[item], loss)
        torch.testing.assert_close(gradients[item], gradient)
    for reduction, expected in (("mean", losses.mean()), ("sum", losses.sum())):
        torch.testing.assert_close(tk.euler_loss(fields, 2.0, 0.05, reduction=reduction, **options), expected)


def test_strides_do_not_matter_and_nothing_is_written_to():
    field = torus(grid(16), 0.5, 0.25) + 0.01 * grid(16)[..., 0]
    turned = field.permute(2, 0, 1)
    before = field.clone()
    for options in (ALONE, {}):
        assert tk.euler_loss(turned, 2.0, 0.05, **options) == tk.euler_loss(turned.contiguous(), 2.0, 0.05, **options)
        cut = field[2:-2, 3:, ::2]  # touches the border
        torch.testing.assert_close(
            tk.euler_loss(cut, 2.0, 0.05, **options), tk.euler_loss(cut.clone(), 2.0, 0.05, **options)
        )
    assert field.equal(before)
    assert not tk.euler_loss(field, 2.0, 0.05).requires_grad


def test_tau_is_found_where_it_is_not_given():
    step = (2 / 19) * 0.5
    for options in (ALONE, {}):
        assert tk.euler_loss(0.4 - P[..., 0], 2.0, **options) == tk.euler_loss(0.4 - P[..., 0], 2.0, step, **options)
    with pytest.raises(InputError, match="has no typical change: pass tau"):
        tk.euler_loss(torch.ones(3, 3, 3), 2.0)


@pytest.mark.parametrize("half", [torch.float16, torch.bfloat16])
def test_half_precision_and_autocast_keep_single_precision_inside(half):
    field = TORUS.to(half)
    for options in (ALONE, {}):
        expected, steep = slope(field.float(), 2.0, 0.05, **options)
        loss, gradient = slope(field, 2.0, 0.05, **options)
        assert loss == expected
        torch.testing.assert_close(gradient, steep.to(half))
        with torch.autocast("cpu", dtype=torch.bfloat16):
            assert slope(field.float(), 2.0, 0.05, **options)[0] == expected


def test_compiled_whole_without_the_guard_and_in_parts_with_it():
    torch._dynamo.reset()
    fields = torch.stack([TORUS, BALL]).float()
    for options, whole in ((ALONE, True), ({}, False)):
        loss = tk.EulerLoss(2.0, **options)
        compiled = torch.compile(loss, fullgraph=whole, backend="aot_eager")
        for tau in (0.1, 0.05):
            leaf = fields.clone().requires_grad_()
            value = compiled(leaf, tau)
            expected, gradient = slope(fields, 2.0, tau, **options)
            torch.testing.assert_close(value.detach(), expected)
            torch.testing.assert_close(torch.autograd.grad(value, leaf)[0], gradient)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_cuda_agrees():
    for options in (ALONE, {}, {"change": "add"}):
        for tau in (0.05, None):
            loss, gradient = slope(TORUS_AND_BLOB, 2.0, tau, **options)
            on_gpu, gradient_there = slope(TORUS_AND_BLOB.cuda(), 2.0, tau, **options)
            assert on_gpu.is_cuda
            torch.testing.assert_close(on_gpu.cpu(), loss)
            torch.testing.assert_close(gradient_there.cpu(), gradient)


# the module's memory


def test_between_looks_the_known_voxels_are_pushed_and_other_grids_are_looked_at_anew():
    loss = tk.EulerLoss(genus=0, look_every=3, change="add")
    losses = [loss(field, 0.02) for field in (TORUS, TORUS - 0.05, BALL, BALL)]
    assert losses[1] > losses[0]  # the membrane is farther away
    assert losses[1] != tk.euler_loss(TORUS - 0.05, genus=0, tau=0.02, change="add")
    assert losses[3] == tk.euler_loss(BALL, genus=0, tau=0.02, change="add")
    p = grid(16)
    for other in (torus(p, 0.5, 0.25), TORUS.expand(2, -1, -1, -1), TORUS):
        assert loss(other, 0.02) == tk.euler_loss(other, genus=0, tau=0.02, change="add")


def test_the_module_mirrors_the_function_and_remembers_per_item():
    loss = tk.EulerLoss(genus=0)
    first = loss(TORUS, 0.05)
    assert first == tk.euler_loss(TORUS, genus=0, tau=0.05) == loss(TORUS, tau=0.05)
    assert not list(loss.parameters())
    assert loss.state_dict() == {}
    known = loss._guards[0]
    loss(TORUS + 0.01, 0.05)
    assert loss._guards[0] is known
    assert loss(torus(grid(16), 0.5, 0.25), 0.05) == tk.euler_loss(torus(grid(16), 0.5, 0.25), genus=0, tau=0.05)
    assert loss._guards[0] is not known  # another grid
    loss(torch.stack([TORUS, BALL]), 0.05)
    assert len(loss._guards) == 2
    loss.reset()
    assert loss._guards == []
    loss(TORUS, 0.05)
    twin = copy.deepcopy(loss)
    twin.load_state_dict(loss.state_dict())
    assert twin._guards[0] is not loss._guards[0]
    assert twin(TORUS, 0.05) == loss(TORUS, 0.05) == first
