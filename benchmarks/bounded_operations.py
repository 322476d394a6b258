"""Functions for every operation that has bounds, and a search for values and gradients outside of them."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from topokit.core.implicit.bounds.gradients import gradients
from topokit.core.implicit.bounds.operations import program_of

Function = Callable[[Tensor], Tensor]
_CHUNK = 1 << 16
_F = nn.functional
_OF_TORCH = "relu tanh sigmoid sin cos exp log sqrt rsqrt erf atan abs reciprocal square log1p"
_OF_LAYERS = "leaky_relu elu celu selu softplus silu gelu mish hardswish hardtanh logsigmoid"
_WEIGHT = torch.linspace(-1.3, 1.7, 12).reshape(4, 3)  # in single precision


def _of_one(curve: Callable[[Tensor], Tensor]) -> Function:
    """A curve of one linear combination of the coordinates."""
    return lambda x: curve(1.3 * x[:, 0] - 0.7 * x[:, 1] + 0.4 * x[:, 2] + 0.1)


OPERATIONS: dict[str, Function] = {
    **{name: _of_one(getattr(torch, name)) for name in _OF_TORCH.split()},
    **{name: _of_one(getattr(_F, name)) for name in _OF_LAYERS.split()},
    "gelu, tanh": _of_one(lambda t: _F.gelu(t, approximate="tanh")),
    "prelu": _of_one(lambda t: _F.prelu(t, t.new_tensor([0.3]))),
    "softplus, beta": _of_one(lambda t: _F.softplus(t, 3.0, 60.0)),
    "cube": _of_one(lambda t: t**3),
    "power -2": _of_one(lambda t: t**-2),
    "clamp": _of_one(lambda t: t.clamp(-0.5, 0.8)),
    "linear": lambda x: _F.linear(x, _WEIGHT.to(x)).sum(1),
    "product": lambda x: x[:, 0] * x[:, 1],
    "quotient": lambda x: x[:, 0] / x[:, 1],
    "minimum": lambda x: torch.minimum(x[:, 0], x[:, 1]),
    "maximum": lambda x: torch.maximum(x[:, 0], x[:, 2]),
    "amax": lambda x: x.amax(1),
    "amin": lambda x: x.amin(1),
    "norm": lambda x: x.norm(dim=1),
    "norm 1": lambda x: torch.linalg.vector_norm(x, 1, dim=1),
    "norm inf": lambda x: torch.linalg.vector_norm(x, float("inf"), dim=1),
    "inner product": lambda x: (x.unsqueeze(1) @ x.flip(1).unsqueeze(2))[:, 0, 0],
    "layer norm": lambda x: _F.layer_norm(x * x.new_tensor([1.0, 2.0, 3.0]), (3,))[:, 0],
    "branches": lambda x: torch.relu(x[:, 0]) - torch.relu(x[:, 1]) - 0.5 * x[:, 0] + 0.5 * x[:, 1],
}


def outside(function: Function, count: int, seed: int) -> int:
    """How many of so many random boxes have a value or a gradient outside of the bounds, at a corner or inside."""
    program = program_of(function, torch.full((1, 3), 0.3, dtype=torch.float64), "f")
    generator = torch.Generator().manual_seed(seed)
    wrong = 0
    for start in range(0, count, _CHUNK):
        n = min(_CHUNK, count - start)
        centers = 4 * torch.rand(n, 3, dtype=torch.float64, generator=generator) - 2
        half = 10 ** (9 * torch.rand(n, 1, dtype=torch.float64, generator=generator) - 8.7)
        half = half * torch.rand(n, 3, dtype=torch.float64, generator=generator)
        forms = program.forms(centers, half)
        lowest, highest = (end[:, 0] for end in forms[-1].ends)
        enclosed = gradients(program, forms)
        is_wrong = torch.zeros(n, dtype=torch.bool)
        for is_corner in (True, False):
            offset = 2 * torch.rand(n, 3, dtype=torch.float64, generator=generator) - 1
            x = (centers + half * (offset.sign() if is_corner else offset)).requires_grad_(True)
            value = function(x)
            (gradient,) = torch.autograd.grad(value.sum(), x)
            direction = 2 * torch.rand(n, 1, 3, dtype=torch.float64, generator=generator) - 1
            is_wrong |= (value < lowest) | (value > highest)
            is_wrong |= (direction * gradient[:, None]).sum(2)[:, 0] < enclosed.least(direction)[:, 0]
        wrong += int(is_wrong.sum())
    return wrong
