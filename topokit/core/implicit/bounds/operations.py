"""A program of bounded steps from any torch function: its graph of ATen operations, one rule for each.

The function is traced at one point, so a step cannot mix points. What does not depend on the point is computed as torch
computes it and taken as exact. Affine operations are applied to unit vectors, which gives their matrices exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import torch
from torch import Tensor
from torch.fx import Node

from topokit.core.implicit.bounds import curves
from topokit.core.implicit.bounds.curves import Curve
from topokit.core.implicit.bounds.program import Affine, Bent, PositivePart, Product, Program, Step
from topokit.core.implicit.bounds.rounding import constant
from topokit.errors import InputError

aten = torch.ops.aten

_NAMES = """view _unsafe_view reshape t transpose permute unsqueeze squeeze expand select slice split split_with_sizes
unbind index_select index flip roll repeat flatten sum mean neg mul div mm bmm matmul dot mv clone alias detach _to_copy
contiguous diagonal movedim narrow positive expand_as view_as"""
_AFFINE: dict[str, tuple[int, ...]] = {
    **dict.fromkeys(("add", "sub", "rsub"), (0, 1)),
    **dict.fromkeys(("cat", "stack"), (0,)),
    **{"addmm": (0,), "baddbmm": (0,), "convolution": (2,), "linear": (2,), "constant_pad_nd": (2,)},
    **dict.fromkeys(_NAMES.split(), ()),
}
"""Operations that are affine in what depends on the point, with the arguments that are added rather than multiplied."""

_MEANT = {"alpha", "beta", "dim", "keepdim"}
_KEYWORDS = _MEANT | {"dtype", "layout", "device", "pin_memory", "non_blocking", "memory_format", "implicit"}
"""Keywords of affine operations: those that matter, and those that do not as long as numbers stay real."""

_OF_CALLS = (AssertionError, AttributeError, IndexError, KeyError, NameError, RuntimeError, TypeError, ValueError)
"""What functions raise that ask more of their points than operations."""

_FILLING = {"new_zeros", "new_ones", "new_full", "zeros_like", "ones_like", "full_like", "scalar_tensor"}
"""Operations that take only the shape of what depends on the point."""

_CURVES: dict[str, Curve] = {
    "sin": curves.SIN,
    "cos": curves.COS,
    "exp": curves.EXP,
    "log": curves.LOG,
    "sqrt": curves.SQRT,
    "tanh": curves.TANH,
    "sigmoid": curves.SIGMOID,
    "silu": curves.SILU,
    "erf": curves.ERF,
    "atan": curves.ATAN,
    "reciprocal": curves.RECIPROCAL,
    "square": curves.SQUARE,
}


@dataclass(frozen=True)
class Slot:
    """What a step gives for one point: its number in the program and the shape that torch sees."""

    number: int
    shape: tuple[int, ...]


def program_of(function: Callable[[Tensor], Tensor], example: Tensor, name: str) -> Program:
    """The steps of a function.

    Args:
        function: maps (N, 3) to N values.
        example: (1, 3), a point in the type that the function takes.
        name: what to call it in errors.

    Raises:
        InputError: if an operation has no bounds (it is named), the values do not depend on the points through torch,
            or the function chooses by the points what to compute.
    """
    from torch.fx.experimental.proxy_tensor import make_fx

    try:
        with torch.no_grad():
            graph = make_fx(function, decomposition_table=_decompositions())(example)
    except _OF_CALLS as error:
        said = " ".join(str(error).split())[:160]
        raise InputError(
            f"{name} cannot be written down as operations, so nothing can be proven about it: {said}. Compute with "
            "operations of torch, and without branches that depend on the points."
        ) from error
    builder = _Builder(name, graph)
    result = builder.run()
    if not isinstance(result, Slot) or torch.Size(result.shape).numel() != 1:
        raise InputError(f"the values of {name} do not depend on the points through torch, so nothing can be proven.")
    if result.number != len(builder.program.steps):
        builder.linear(lambda x: x.clone(), result, always=True)
    return builder.program


def _decompositions() -> dict[Any, Callable[..., Any]]:
    from torch._decomp import get_decompositions

    names = (
        "native_layer_norm native_batch_norm _native_batch_norm_legit_no_training cudnn_batch_norm native_group_norm "
        " hardswish hardsigmoid mish addcmul addcdiv lerp logaddexp"
    )
    found: dict[Any, Callable[..., Any]] = get_decompositions([getattr(aten, one) for one in names.split()])
    return found


class _Builder:
    """Adds steps to a program, operation by operation of a graph."""

    def __init__(self, name: str, graph: torch.fx.GraphModule) -> None:
        self.name, self.graph, self.program = name, graph, Program()

    def run(self) -> Any:
        """What the graph returns."""
        known: dict[Node, Any] = {}
        for node in self.graph.graph.nodes:
            if node.op == "placeholder":
                known[node] = Slot(0, (1, 3))
            elif node.op == "get_attr":
                known[node] = attrgetter(str(node.target))(self.graph)
            else:
                arguments = torch.fx.map_arg(node.args, known.__getitem__)
                if node.op == "output":
                    return arguments[0]
                keywords = torch.fx.map_arg(node.kwargs, known.__getitem__)
                known[node] = self._result(node, arguments, dict(keywords))
        return None

    def _result(self, node: Node, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        target: Any = node.target
        if not _slots(arguments) and not _slots(tuple(keywords.values())):
            return target(*arguments, **keywords)
        if not isinstance(target, torch._ops.OpOverload):  # getitem
            return target(*arguments, **keywords)
        found = self._rule(target._opname.rstrip("_"), target, arguments, keywords)
        if found is None:
            raise InputError(
                f"{self.name} uses {target._opname}, for which there are no bounds, so nothing can be proven about it."
            )
        return found

    def _rule(self, name: str, op: Any, given: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        x = given[0]
        if name in _FILLING:
            return op(torch.zeros(x.shape, dtype=torch.float64), *given[1:], **keywords)
        if name in _CURVES:
            return self.curve(x, _CURVES[name])
        if name in _RULES:
            return _RULES[name](self, *given, **keywords)
        slots = _slots(given)
        if name == "mul" and len(slots) == 2:
            return self.product(*slots)
        if name == "div" and isinstance(given[1], Slot):
            return self.product(given[0], self.curve(given[1], curves.RECIPROCAL))
        if name in ("mm", "bmm", "matmul", "dot") and len(slots) == 2:
            return self._inner(*slots)
        if name not in _AFFINE or not set(keywords) <= _KEYWORDS or not _stays_real(given, keywords):
            return None
        kept = {key: value for key, value in keywords.items() if key in _MEANT}
        return self.affine(op, given, kept, _AFFINE[name])

    def step(self, step: Step, shape: Sequence[int]) -> Slot:
        """A new step."""
        self.program.steps.append(step)
        self.program.widths.append(torch.Size(shape).numel())
        return Slot(len(self.program.steps), tuple(shape))

    def affine(
        self, op: Callable[..., Any], given: tuple[Any, ...], keywords: dict[str, Any], added: Sequence[int]
    ) -> Any:
        """The step, or the list of them, of an operation that is affine in its slots."""
        slots = list(dict.fromkeys(_slots(given)))
        zeros = {slot: torch.zeros(slot.shape, dtype=torch.float64) for slot in slots}

        def result(values: dict[Slot, Tensor], is_linear: bool) -> tuple[Tensor, ...]:
            filled = [_filled(one, values, is_linear and place in added) for place, one in enumerate(given)]
            answer = op(*filled, **keywords)
            return (answer,) if isinstance(answer, Tensor) else tuple(answer)

        offsets = result(zeros, False)
        columns: list[list[list[Tensor]]] = [[[] for _ in slots] for _ in offsets]
        for number, slot in enumerate(slots):
            for unit in torch.eye(zeros[slot].numel(), dtype=torch.float64):
                for place, part in enumerate(result({**zeros, slot: unit.reshape(slot.shape)}, True)):
                    columns[place][number].append(part.reshape(-1))
        made = []
        is_one = isinstance(op(*[_filled(one, zeros, False) for one in given], **keywords), Tensor)
        for offset, matrices in zip(offsets, columns, strict=True):
            stacked = tuple(torch.stack(rows).to(torch.float64) for rows in matrices)
            made.append(self._affine_step(slots, stacked, offset.to(torch.float64)))
        return made[0] if is_one else made

    def _affine_step(self, slots: list[Slot], matrices: tuple[Tensor, ...], offset: Tensor) -> Slot:
        [first, *others] = matrices
        is_same = not others and not offset.any() and first.shape[0] == first.shape[1]
        if is_same and torch.equal(first, torch.eye(len(first), dtype=first.dtype)):
            return Slot(slots[0].number, tuple(offset.shape))
        numbers = tuple(slot.number for slot in slots)
        return self.step(Affine(numbers, matrices, offset.reshape(-1).clone()), offset.shape)

    def linear(self, function: Callable[..., Tensor], *given: Any, always: bool = False) -> Slot:
        """A function that is linear in its slots, with constants that are multiplied."""
        if always:
            width = torch.Size(given[0].shape).numel()
            zero = torch.zeros(width, dtype=torch.float64)
            return self.step(Affine((given[0].number,), (zero.new_ones(width).diag(),), zero), given[0].shape)
        made: Slot = self.affine(function, given, {}, ())
        return made

    def add(self, left: Any, right: Any, scale: float = 1.0) -> Slot:
        """left + scale · right."""
        made: Slot = self.affine(lambda a, b: torch.add(a, b, alpha=scale), (left, right), {}, (0, 1))
        return made

    def scaled(self, x: Any, factor: float) -> Slot:
        """factor · x."""
        return x if factor == 1 else self.linear(lambda a: a * factor, x)

    def curve(self, x: Slot, curve: Curve) -> Slot:
        """A curve of every entry."""
        return self.step(Bent(x.number, curve), x.shape)

    def positive(self, x: Slot) -> Slot:
        """max(x, 0)."""
        return self.step(PositivePart(x.number), x.shape)

    def product(self, left: Any, right: Any) -> Slot:
        """left · right, broadcast."""
        if not isinstance(left, Slot):
            made: Slot = self.affine(lambda a, b: a * b, (left, right), {}, ())
            return made
        if left == right:
            return self.curve(left, curves.SQUARE)
        shape = torch.broadcast_shapes(left.shape, right.shape)
        a, b = (self.linear(lambda x: x.expand(shape), one) for one in (left, right))
        return self.step(Product(a.number, b.number), shape)

    def maximum(self, left: Any, right: Any) -> Slot:
        """The larger of two."""
        return self.add(left, self.positive(self.add(right, left, -1.0)))

    def _inner(self, left: Slot, right: Slot) -> Slot:
        """A product of matrices that both depend on the point."""
        both = self.product(self.linear(lambda x: x.unsqueeze(-1), left), self.linear(lambda x: x.unsqueeze(-3), right))
        return self.linear(lambda x: x.sum(-2), both)


def _slots(given: Sequence[Any]) -> list[Slot]:
    found = []
    for one in given:
        if isinstance(one, Slot):
            found.append(one)
        elif isinstance(one, list | tuple):
            found += _slots(one)
    return found


def _stays_real(given: Sequence[Any], keywords: dict[str, Any]) -> bool:
    """Whether no argument asks for integers, to which numbers would be rounded."""
    types = [one for one in (*given, *keywords.values()) if isinstance(one, torch.dtype)]
    return all(one.is_floating_point for one in types)


def _filled(one: Any, values: dict[Slot, Tensor], vanishes: bool) -> Any:
    """An argument with tensors in place of slots; constants that are added are 0 where only slopes are wanted."""
    if isinstance(one, Slot):
        return values[one]
    if isinstance(one, list | tuple) and _slots(one):
        return [_filled(part, values, vanishes) for part in one]
    if isinstance(one, Tensor) and one.is_floating_point():
        return torch.zeros_like(constant(one)) if vanishes else constant(one)
    if isinstance(one, Tensor):
        return torch.zeros_like(one) if vanishes else one.cpu()
    return 0.0 if vanishes and isinstance(one, int | float) else one


def _elu(b: _Builder, x: Slot, alpha: float = 1.0, scale: float = 1.0, input_scale: float = 1.0) -> Slot:
    """Scaled ELU: a smooth part and, unless alpha times the input's scale is 1, a kink."""
    smooth = b.scaled(b.curve(b.scaled(x, input_scale), curves.ELU), alpha)
    if alpha * input_scale == 1:
        return b.scaled(smooth, scale)
    return b.scaled(b.add(smooth, b.positive(x), 1 - alpha * input_scale), scale)


def _softplus(b: _Builder, x: Slot, beta: float = 1.0, threshold: float = 20.0) -> Slot:
    """Softplus itself: torch replaces it by x beyond the threshold, where it differs by less than exp(−threshold)."""
    return b.scaled(b.curve(b.scaled(x, beta), curves.SOFTPLUS), 1 / beta)


def _gelu(b: _Builder, x: Slot, approximate: str = "none") -> Slot:
    if approximate == "none":
        return b.curve(x, curves.GELU)
    inner = b.scaled(b.add(x, b.curve(x, curves.power(3)), 0.044715), (2 / torch.pi) ** 0.5)
    return b.scaled(b.product(x, b.add(b.curve(inner, curves.TANH), torch.ones(x.shape))), 0.5)


def _leaky(b: _Builder, x: Slot, slope: float = 0.01) -> Slot:
    return b.add(b.scaled(x, slope), b.positive(x), 1 - slope)


def _prelu(b: _Builder, x: Slot, weight: Tensor) -> Slot:
    shape = (1, -1, *(1,) * (len(x.shape) - 2)) if len(x.shape) > 1 else (-1,)
    slope = constant(weight).reshape(shape).expand(x.shape)
    return b.add(b.product(slope, x), b.product(1 - slope, b.positive(x)))


def _abs(b: _Builder, x: Slot) -> Slot:
    return b.add(b.scaled(b.positive(x), 2.0), x, -1.0)


def _clamp(b: _Builder, x: Slot, low: Any = None, high: Any = None, **limits: Any) -> Slot:
    low, high = limits.get("min", low), limits.get("max", high)
    if low is not None:
        x = b.maximum(x, low if isinstance(low, Slot) else constant(low).expand(x.shape))
    return x if high is None else _minimum(b, x, high if isinstance(high, Slot) else constant(high).expand(x.shape))


def _minimum(b: _Builder, left: Any, right: Any) -> Slot:
    return b.add(left, b.positive(b.add(left, right, -1.0)), -1.0)


def _extreme(sign: float, returns_indices: bool) -> Callable[..., Any]:
    """max or min along one axis, by halves."""

    def rule(b: _Builder, x: Slot, dim: Any = None, keepdim: bool = False) -> Any:
        if isinstance(dim, Slot | Tensor):  # of two, not along an axis
            return b.maximum(x, dim) if sign > 0 else _minimum(b, x, dim)
        axes = range(len(x.shape)) if dim is None or dim == [] else dim if isinstance(dim, list | tuple) else [dim]
        if len(axes) != 1:
            return None
        [axis] = axes
        x = b.linear(lambda a: sign * a.movedim(axis, -1), x)
        while (n := x.shape[-1]) > 1:
            half = n // 2
            pair = (b.linear(lambda a, at=at, half=half: a[..., at : at + half], x) for at in (0, half))
            larger = b.maximum(*pair)
            rest = b.linear(lambda a, half=half: a[..., 2 * half :], x) if n % 2 else None
            x = larger if rest is None else b.affine(lambda *parts: torch.cat(parts, -1), (larger, rest), {}, ())
        x = b.linear(lambda a: sign * (a.movedim(-1, axis) if keepdim else a[..., 0]), x)
        return (x, None) if returns_indices else x

    return rule


def _power(b: _Builder, x: Slot, exponent: Any) -> Slot | None:
    if not isinstance(x, Slot) or not isinstance(exponent, int | float):
        return None
    value = float(exponent)
    if value == 0.5:
        return b.curve(x, curves.SQRT)
    if value == int(value) and 2 <= abs(value) <= 64:
        powered = b.curve(x, curves.power(int(abs(value))))
        return powered if value > 0 else b.curve(powered, curves.RECIPROCAL)
    if abs(value) == 1:
        return x if value > 0 else b.curve(x, curves.RECIPROCAL)
    return None


def _norm(b: _Builder, x: Slot, order: float = 2, dim: Any = None, keepdim: bool = False, **dtype: Any) -> Slot | None:
    axes = tuple(range(len(x.shape))) if dim is None else tuple(dim)
    if order == 2:
        squares = b.curve(x, curves.SQUARE)
        return b.curve(b.linear(lambda a: a.sum(axes, keepdim), squares), curves.SQRT)
    if order == 1:
        return b.linear(lambda a: a.sum(axes, keepdim), _abs(b, x))
    if order == float("inf") and len(axes) == 1:
        found: Slot = _extreme(1.0, False)(b, _abs(b, x), axes[0], keepdim)
        return found
    return None


def _variance(b: _Builder, x: Slot, dim: Any = None, correction: float | None = 1, keepdim: bool = False) -> Slot:
    axes = tuple(range(len(x.shape))) if dim is None else tuple(dim)
    count = torch.Size([x.shape[axis] for axis in axes]).numel() - (1 if correction is None else correction)
    squares = b.curve(b.linear(lambda a: a - a.mean(axes, keepdim=True), x), curves.SQUARE)
    return b.linear(lambda a: a.sum(axes, keepdim) / count, squares)


def _rsqrt(b: _Builder, x: Slot) -> Slot:
    return b.curve(b.curve(x, curves.SQRT), curves.RECIPROCAL)


_RULES: dict[str, Callable[..., Any]] = {
    "relu": lambda b, x: b.positive(x),
    "leaky_relu": _leaky,
    "prelu": _prelu,
    "_prelu_kernel": _prelu,
    "elu": _elu,
    "celu": lambda b, x, alpha=1.0: b.scaled(b.curve(b.scaled(x, 1 / alpha), curves.ELU), alpha),
    "convert_element_type": lambda b, x, dtype: x if dtype.is_floating_point else None,
    "softplus": _softplus,
    "gelu": _gelu,
    "abs": _abs,
    "clamp": _clamp,
    "clamp_min": lambda b, x, low: _clamp(b, x, low),
    "clamp_max": lambda b, x, high: _clamp(b, x, None, high),
    "hardtanh": lambda b, x, low=-1.0, high=1.0: _clamp(b, x, low, high),
    "maximum": lambda b, x, y: b.maximum(x, y),
    "minimum": _minimum,
    "amax": _extreme(1.0, False),
    "amin": _extreme(-1.0, False),
    "max": _extreme(1.0, True),
    "min": _extreme(-1.0, True),
    "pow": _power,
    "linalg_vector_norm": _norm,
    "rsqrt": _rsqrt,
    "var": _variance,
    "var_mean": lambda b, x, dim=None, correction=1, keepdim=False: [
        _variance(b, x, dim, correction, keepdim),
        b.linear(lambda a: a.mean(dim, keepdim), x),
    ],
    "log1p": lambda b, x: b.curve(b.add(x, torch.ones(x.shape)), curves.LOG),
    "log_sigmoid_forward": lambda b, x: [b.scaled(_softplus(b, b.scaled(x, -1.0)), -1.0), None],
}
