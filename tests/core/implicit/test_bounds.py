"""Bounds of functions and gradients: what they enclose is compared with values and gradients at random points."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from topokit.core.implicit.bounds import curves
from topokit.core.implicit.bounds.curves import Curve
from topokit.core.implicit.bounds.gradients import gradients
from topokit.core.implicit.bounds.operations import program_of
from topokit.core.implicit.bounds.rounding import FUNCTION, from_function
from topokit.errors import InputError

Function = Callable[[Tensor], Tensor]

CURVES: dict[str, Curve] = {
    "tanh": curves.TANH,
    "sigmoid": curves.SIGMOID,
    "softplus": curves.SOFTPLUS,
    "elu": curves.ELU,
    "silu": curves.SILU,
    "gelu": curves.GELU,
    "erf": curves.ERF,
    "atan": curves.ATAN,
    "sin": curves.SIN,
    "cos": curves.COS,
    "exp": curves.EXP,
    "square": curves.SQUARE,
    "cube": curves.power(3),
    "fourth": curves.power(4),
    "log": curves.LOG,
    "sqrt": curves.SQRT,
    "reciprocal": curves.RECIPROCAL,
}
EXACT: dict[str, Callable[[mpmath.mpf], mpmath.mpf]] = {
    "sigmoid": lambda x: 1 / (1 + mpmath.exp(-x)),
    "softplus": lambda x: mpmath.log1p(mpmath.exp(x)),
    "elu": lambda x: x if x > 0 else mpmath.expm1(x),
    "silu": lambda x: x / (1 + mpmath.exp(-x)),
    "gelu": lambda x: x * mpmath.ncdf(x),
    "square": lambda x: x**2,
    "cube": lambda x: x**3,
    "fourth": lambda x: x**4,
    "reciprocal": lambda x: 1 / x,
}


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_and_its_derivatives_stay_in_their_ranges(name: str) -> None:
    curve = CURVES[name]
    generator = torch.Generator().manual_seed(0)
    low = 8 * torch.rand(3_000, dtype=torch.float64, generator=generator) - 4
    low = low.abs() + 1e-3 if name in ("log", "sqrt", "reciprocal") else low
    high = low + torch.logspace(-9, 1, 3_000, dtype=torch.float64)
    share = torch.linspace(0, 1, 41, dtype=torch.float64)[:, None]
    x = (low + share * (high - low)).clamp(low, high).requires_grad_(True)
    value = curve.value(x)
    (slope,) = torch.autograd.grad(value.sum(), x, create_graph=True)
    (bend,) = torch.autograd.grad(slope.sum(), x)
    bend = torch.where(x == 0, 0.0, bend)  # torch takes either side of a jump
    for found, ranges in ((value, curve.values), (slope, curve.slopes), (bend, curve.bends)):
        lowest, highest = ranges(low, high)
        off = 1e-13 * (1 + found.abs()) if found is bend else 0.0  # autograd's own rounding
        assert bool(((found.detach() >= lowest - off) & (found.detach() <= highest + off)).all())
        wide = (highest - lowest)[:300].max()  # on intervals of at most 1e-8
        assert float(wide) < 1e-5 * (1 + float(found.detach()[:, :300].abs().max())), "the ranges are narrow, too"
    np.testing.assert_allclose(curve.slope(x).detach(), slope.detach(), atol=1e-13, rtol=1e-12)


@pytest.mark.parametrize("name", CURVES)
def test_functions_of_torch_are_as_accurate_as_the_bounds_assume(name: str) -> None:
    curve = CURVES[name]
    exact = EXACT.get(name) or getattr(mpmath, name)
    x = torch.cat((torch.linspace(-30, 30, 301), torch.logspace(-8, 2, 100))).double()
    x = x.abs() + 1e-6 if name in ("log", "sqrt", "reciprocal") else x
    found = curve.value(x)
    with mpmath.workdps(40):
        errors = [abs(mpmath.mpf(float(f)) - exact(mpmath.mpf(float(a)))) for a, f in zip(x, found, strict=True)]
    allowed = from_function(found, found)[1] - found
    assert bool((torch.tensor([float(error) for error in errors]) <= allowed / 10).all()), "a tenth of what is assumed"
    assert FUNCTION < 1e-13


def seeded(make: Callable[[], nn.Module]) -> nn.Module:
    torch.manual_seed(0)
    return make().double()


class Skip(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.first, self.second, self.last = nn.Linear(3, 16), nn.Linear(19, 16), nn.Linear(16, 1)

    def forward(self, x: Tensor) -> Tensor:
        inner = self.second(torch.cat((torch.relu(self.first(x)), x), dim=1))
        return self.last(nn.functional.selu(inner) + nn.functional.celu(inner, 0.5))


class Encoded(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.first, self.last = nn.Linear(15, 16), nn.Linear(16, 1)
        self.code = nn.Parameter(torch.zeros(1, 16))

    def forward(self, x: Tensor) -> Tensor:
        waves = [wave(x * 2**k) for k in range(2) for wave in (torch.sin, torch.cos)]
        return self.last(torch.relu(self.first(torch.cat((x, *waves), dim=1)) + self.code.expand(len(x), -1)))


def mlp(*activations: nn.Module) -> nn.Module:
    layers: list[nn.Module] = [nn.Linear(3, 16)]
    for activation in activations:
        layers += [activation, nn.Linear(16, 16)]
    return nn.Sequential(*layers[:-1], nn.Linear(16, 1))


def unwrapped(net: nn.Module, function: Callable[[nn.Module, Tensor], Tensor]) -> Function:
    return lambda x: function(net, x)


FUNCTIONS: dict[str, Function] = {
    "relu": seeded(lambda: mlp(nn.ReLU(), nn.ReLU(), nn.ReLU())),
    "leaky": seeded(lambda: mlp(nn.LeakyReLU(0.2), nn.PReLU(), nn.Sigmoid())),
    "tanh, softplus": seeded(lambda: mlp(nn.Tanh(), nn.Softplus(2.0, 40.0))),
    "elu, silu, gelu": seeded(lambda: mlp(nn.ELU(), nn.SiLU(), nn.GELU(), nn.GELU(approximate="tanh"), nn.Mish())),
    "hard": seeded(lambda: mlp(nn.Hardtanh(), nn.Hardswish(), nn.LogSigmoid())),
    "normalized": seeded(
        lambda: nn.Sequential(
            nn.utils.parametrizations.weight_norm(nn.Linear(3, 16)), nn.LayerNorm(16), nn.SiLU(), nn.Linear(16, 1)
        )
    ),
    "skip": seeded(Skip),
    "encoded": seeded(Encoded),
    "siren": unwrapped(seeded(lambda: mlp(nn.Identity())), lambda net, x: net[2](torch.sin(9 * net[0](x)))[:, :1]),
    "conv": unwrapped(
        seeded(lambda: nn.Sequential(nn.Conv1d(3, 8, 1), nn.ReLU(), nn.Conv1d(8, 1, 1))),
        lambda net, x: net(x.T[None])[0, 0],
    ),
    "branches": lambda x: torch.relu(x[:, 0]) - torch.relu(x[:, 1]) - 0.5 * x[:, 0] + 0.5 * x[:, 1],
    "two networks": unwrapped(
        seeded(lambda: nn.ModuleList([mlp(nn.ReLU(), nn.ReLU()), mlp(nn.ReLU(), nn.SiLU(), nn.ReLU())])),
        lambda net, x: net[0](x) - torch.maximum(net[1](x), 0.5 * net[0](x) + net[0](x.flip(1))),
    ),
    "polynomial": lambda x: (x**4).sum(1) - 1.2 * (x * x).sum(1) + x[:, 0] * x[:, 1] * x[:, 2] + 0.3,
    "torus": lambda x: ((x[:, :2].norm(dim=1) - 0.6) ** 2 + x[:, 2] ** 2).sqrt() - 0.2,
    "gyroid": lambda x: (torch.sin(5 * x) * torch.cos(5 * x.roll(1, 1))).sum(1),
    "box": lambda x: (x.abs() - 0.5).clamp(min=0).norm(dim=1) + (x.abs() - 0.5).amax(1).clamp(max=0) - 0.1,
    "union": lambda x: torch.minimum((x - 0.3).norm(dim=1) - 0.5, (x + 0.3).norm(dim=1) - 0.5),
    "quotient": lambda x: (
        x[:, 0] / (2 + x[:, 1] ** 2) - torch.exp(-x[:, 2]) + torch.log(3 + x[:, 2]) + 1 / (3 + x[:, 1])
    ),
    "matrices": lambda x: (x.unsqueeze(1) @ x.unsqueeze(2))[:, 0, 0] - torch.rsub(x[:, 0], 2) + x.max(dim=1).values,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_and_gradients_are_never_outside_of_their_bounds(name: str) -> None:
    function = FUNCTIONS[name]
    program = program_of(function, torch.full((1, 3), 0.1, dtype=torch.float64), name)
    generator = torch.Generator().manual_seed(1)

    def uniform(*shape: int) -> Tensor:
        return 2 * torch.rand(*shape, dtype=torch.float64, generator=generator) - 1

    widths = []
    for scale in (1.0, 2.0**-4, 2.0**-12):
        half, centers = scale * (uniform(150, 3) + 1) / 2, uniform(150, 3)
        forms = program.forms(centers, half)
        lowest, highest = forms[-1].ends
        enclosed = gradients(program, forms)
        for turn in range(20):
            offset = uniform(150, 3)
            x = (centers + half * (offset.sign() if turn % 3 == 0 else offset)).requires_grad_(True)
            value = function(x).reshape(-1, 1)
            (gradient,) = torch.autograd.grad(value.sum(), x)
            assert not bool(((value < lowest) | (value > highest)).any())
            directions = uniform(150, 4, 3)
            assert not bool(((directions * gradient[:, None]).sum(2) < enclosed.least(directions)).any())
        widths.append(float((highest - lowest).median()))
        at_point = program.forms(centers, centers[:0])[-1]
        assert bool(((function(centers).reshape(-1, 1) - at_point.center).abs() <= at_point.radius).all())
    assert widths[2] < min(1e-2 * widths[0], 0.02), "bounds are of use where boxes are small"


def test_weights_in_single_precision_are_exact_numbers() -> None:
    net = nn.Linear(3, 1)
    program = program_of(net, torch.zeros(1, 3), "net")
    point = torch.tensor([[0.3, -0.2, 0.9]], dtype=torch.float64)
    found = program.forms(point, point[:0])[-1]
    exact = net.double()(point).detach()
    assert float((found.center - exact).abs()) <= float(found.radius) < 1e-12


@pytest.mark.filterwarnings("ignore:.*torch.jit.trace:DeprecationWarning")
def test_functions_in_files_are_read_like_modules() -> None:
    net = seeded(lambda: mlp(nn.ReLU(), nn.Tanh()))
    point = torch.full((1, 3), 0.2, dtype=torch.float64)
    script = torch.jit.trace(net, torch.zeros(5, 3, dtype=torch.float64))
    counts = [len(program_of(one, point, "net").steps) for one in (net, script)]
    assert counts[0] == counts[1] == 5


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lambda x: torch.where(x[:, 0] > 0, x[:, 1], x[:, 2]), "uses gt"),
        (lambda x: torch.floor(x).sum(1), "uses floor"),
        (lambda x: x.to(torch.int64).sum(1) * 1.0, "uses _to_copy"),
        (lambda x: torch.div(x, 2.0, rounding_mode="floor").sum(1), "uses div"),
        (lambda x: nn.functional.dropout(x, 0.5).sum(1), "uses"),
        (lambda x: x.sum(1) if x.sum() > 0 else -x.sum(1), "branches"),
        (lambda x: torch.ones(len(x)), "do not depend"),
        (lambda x: 2 ** x[:, 0], "uses pow"),
        (lambda x: x.detach().numpy().sum(1) * x[:, 0].detach(), "uses|do not depend|cannot be written"),
    ],
)
def test_what_has_no_bounds_is_named(function: Function, said: str) -> None:
    with pytest.raises(InputError, match=said):
        program_of(function, torch.full((1, 3), 0.1, dtype=torch.float64), "f")
