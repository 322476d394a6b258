"""A user's callable as a field that is positive inside: its dtype, device, values and derivatives."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any

import torch
from torch import Tensor

from topokit.core.grid.field import Field
from topokit.core.grid.grid import Grid
from topokit.core.precision import full_precision
from topokit.core.residence import stays_on_device
from topokit.errors import InputError, Option, summary

Function = Callable[[Tensor], Tensor]
BATCH_SIZE = 1 << 16  # points per call, at most

_GUARD = "Expected input at"  # how torch 2.8 says what later ones assert
_NUMPY = "Can't call numpy() on Tensor that requires grad"
_NO_MEMORY = "out of memory", "DefaultCPUAllocator"  # in a RuntimeError: of mps and drivers, and of the CPU
# What calls with the wrong type or number of points raise; AssertionError is that of the guards of torch.export.
_OF_CALLS = (AssertionError, AttributeError, IndexError, NameError, RuntimeError, TypeError, ValueError)


class LevelFunction:
    """F = sign · (f − level), positive inside, evaluated on the device and in the dtype that f computes in.

    Args:
        f: maps (N, 3) tensors to (N,) or (N, 1).
        level: value of f on the surface.
        sign: +1 where f is high inside, −1 where it is low inside.
        name: what to call f in errors.
        probe: (m, 3) positions for the first call.
        batch_size: points per call of f, at most; halved for good where a call runs out of memory.
        is_probability: whether values should be from 0 to 1.

    Raises:
        InputError: if f cannot be called with points of any common type and device, or returns something else than
            one finite number per point.
    """

    def __init__(
        self,
        f: Function,
        level: float,
        sign: int,
        name: str,
        probe: Tensor,
        batch_size: int = BATCH_SIZE,
        is_probability: bool = False,
    ) -> None:
        self.f, self.level, self.sign, self.name = f, level, sign, name
        self.batch_size, self.is_probability = batch_size, is_probability
        self.dtype, self.device = self._dtype_and_device(probe)
        self.n_evaluations = 0

    def versions(self) -> tuple[int, ...]:
        """Counters that change with the weights of a network, as in an optimizer step; none of other functions."""
        weights = self.f.parameters() if isinstance(self.f, torch.nn.Module) else ()
        return tuple(0 if one.is_inference() else one._version for one in weights)

    def __call__(self, points: Tensor) -> Tensor:
        """Values (N,) at positions (N, 3), with a graph to points and weights where gradients are on.

        f runs in the precision of its weights, whatever `torch.autocast` says outside: every answer is about one field.
        On accelerators NaN is not checked, as that would make the host wait for the device: NaN gives NaN.

        Raises:
            InputError: on a wrong shape, if f refuses the number of points or needs too much memory for one, and on the
                CPU on NaN, naming the point.
        """
        return self._in_batches(points, lambda part: (self._values(part, checked=False),))[0]

    def without_graph(self, points: Tensor) -> Tensor:
        """Values (N,) on the CPU, detached; NaN is an InputError on every device."""
        with torch.no_grad():
            return self._in_batches(points, lambda part: (self._values(part, checked=True).cpu(),))[0]

    def value_and_gradient(self, points: Tensor, create_graph: bool = False) -> tuple[Tensor, Tensor]:
        """Values (N,) and spatial gradients (N, 3); detached, and NaN is an InputError, unless `create_graph`.

        The gradient is zero where f does not depend on the points through torch.
        """
        if create_graph:
            return self._with_gradient(points, self, create_graph=True)
        values_at = partial(self._values, checked=True)
        values, gradient = self._in_batches(points, lambda part: self._with_gradient(part, values_at))
        return values, gradient

    @full_precision
    def _with_gradient(self, points: Tensor, values_at: Function, create_graph: bool = False) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            at = points if create_graph and points.requires_grad else points.detach().requires_grad_(True)
            values = values_at(at)
            gradient = None
            if values.requires_grad:
                gradient = torch.autograd.grad(values.sum(), at, create_graph=create_graph, allow_unused=True)[0]
        if gradient is None:
            gradient = torch.zeros_like(points)
        return (values, gradient) if create_graph else (values.detach(), gradient)

    @full_precision
    def _in_batches(self, points: Tensor, call: Callable[[Tensor], tuple[Tensor, ...]]) -> tuple[Tensor, ...]:
        """What the call returns for all points, in batches that are halved as long as memory does not suffice."""
        found: list[tuple[Tensor, ...]] = []
        start, size = 0, self.batch_size
        while start < len(points) or not found:
            part = points[start : start + size]
            try:
                found.append(call(part))
            except (MemoryError, RuntimeError) as error:
                if not _is_out_of_memory(error):
                    raise
                if len(part) <= 1:
                    raise InputError(
                        f"{self.name} runs out of memory with one point more ({summary(error)}): use a smaller "
                        "network, or lower ",
                        *(Option("n_samples"), " or ", Option("field_resolution")),
                        ", as gradients keep what all points need.",
                    ) from error
                size = len(part) // 2
                continue
            start += size
        self.batch_size = size
        self.n_evaluations += len(points)
        return tuple(torch.cat(column) for column in zip(*found, strict=True))

    def _values(self, points: Tensor, *, checked: bool) -> Tensor:
        """Values of one call; `checked` says whether to refuse NaN on accelerators, too."""
        inputs = points.to(self.device, self.dtype)
        values = self.sign * (self._one_per_point(self._answer(inputs), len(inputs)) - self.level)
        is_nan = values.detach().isnan()
        if (checked or not stays_on_device(values)) and is_nan.any():
            where = ", ".join(f"{x:.4g}" for x in inputs[is_nan][0].tolist())
            raise InputError(
                f"{self.name} is NaN at {int(is_nan.sum())} of {len(inputs)} points, the first at ({where}): look for "
                "a division by zero or a root of a negative number there, or for weights that are NaN."
            )
        return values

    def _answer(self, inputs: Tensor) -> object:
        try:
            return self.f(inputs)
        except (AssertionError, RuntimeError) as error:
            if _NUMPY in str(error):
                raise InputError(
                    f"{self.name} leaves torch (.numpy()), so it has no gradient, which samples and curvature need. "
                    "Compute with operations of torch; or call .detach().cpu().numpy(): then normals are differences "
                    "of values, and nothing depends on weights."
                ) from error
            if isinstance(error, RuntimeError) and _GUARD not in str(error):
                raise
            raise InputError(
                f"{self.name} refuses {len(inputs)} points ({summary(error)}). A program of torch.export takes any "
                "number of points if it is exported with dynamic_shapes."
            ) from error

    def __getstate__(self) -> dict[str, Any]:
        """What is sent to another process; TorchScript cannot be pickled, but writes itself into a file."""
        if not isinstance(self.f, torch.jit.ScriptModule):
            return vars(self)
        torch.jit.save(self.f, file := io.BytesIO())
        return {**vars(self), "f": None, "script": file.getvalue()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The function in another process."""
        script = state.pop("script", None)
        vars(self).update(state)
        if script is not None:
            self.f = torch.jit.load(io.BytesIO(script), map_location=self.device)

    @full_precision
    def _dtype_and_device(self, probe: Tensor) -> tuple[torch.dtype, torch.device]:
        """Those of f's weights, else the first that it accepts."""
        tried: list[str] = []
        for dtype, device in _candidates(self.f):
            try:
                with torch.no_grad():
                    answer = self.f(probe.to(device, dtype))
            except _OF_CALLS as error:
                said = " ".join(str(error).split())[:200]
                tried.append(f"{dtype} on {device}: {type(error).__name__}: {said}")
                continue
            self._one_per_point(answer, len(probe))
            return dtype, device
        raise InputError(
            f"{self.name} cannot be called with a tensor of points ({len(probe)}, 3); expected a callable that maps "
            f"(N, 3) to (N,) or (N, 1). It said, with {tried[0]}."
        )

    def _one_per_point(self, answer: object, n_points: int) -> Tensor:
        if not isinstance(answer, Tensor):
            wrap = " Wrap it: lambda x: torch.as_tensor(f(x))." if hasattr(answer, "__array__") else ""
            raise InputError(f"{self.name} returns {type(answer).__name__}; expected a tensor (N,) or (N, 1).{wrap}")
        if tuple(answer.shape) not in ((n_points,), (n_points, 1)):
            raise InputError(
                f"{self.name} maps points ({n_points}, 3) to shape {tuple(answer.shape)}; expected ({n_points},) or "
                f"({n_points}, 1), one number per point. Of several outputs pass one: lambda x: f(x)[:, 0]."
            )
        answer = answer.reshape(n_points)
        return answer if answer.is_floating_point() else answer.to(torch.get_default_dtype())


def _is_out_of_memory(error: Exception) -> bool:
    """Whether a call failed for want of memory, which fewer points may need less of."""
    return isinstance(error, MemoryError | torch.OutOfMemoryError) or any(said in str(error) for said in _NO_MEMORY)


def uncompiled() -> AbstractContextManager[object]:
    """A context in which compiled networks run as they were written: compiled code has no second derivatives."""
    if "torch._dynamo" not in sys.modules:  # importing it takes a second, and nothing can be compiled without it
        return nullcontext()
    return torch.compiler.set_stance("force_eager")


def _candidates(f: Function) -> list[tuple[torch.dtype, torch.device]]:
    if isinstance(f, torch.nn.Module):
        for tensor in (*f.parameters(), *f.buffers()):
            if tensor.is_floating_point():
                return [(tensor.dtype, tensor.device)]
    n_cuda = torch.cuda.device_count()
    devices = ["cpu", *(["cuda"] if n_cuda else []), *(f"cuda:{n}" for n in range(n_cuda))]  # the current one first
    return [
        (dtype, torch.device(device))
        for device in devices
        for dtype in (torch.get_default_dtype(), torch.float32, torch.float64)
    ]


class FunctionField(Field):
    """A function on a grid of its own; single vertices can be evaluated without the others."""

    is_costly = True

    def __init__(self, function: LevelFunction, grid: Grid, connectivity: int, is_log_odds: bool = False) -> None:
        """
        Args:
            function: positive inside.
            grid: where to evaluate it.
            connectivity: 6 or 26, that of the solid.
            is_log_odds: see `Field`.
        """
        super().__init__(grid, connectivity)
        self.function, self.is_log_odds = function, is_log_odds

    @property
    def device(self) -> torch.device:
        """See `Field.device`."""
        return self.function.device

    def values(self) -> Tensor:
        """F (X, Y, Z), positive inside; with a graph to the weights where gradients are on."""
        return self._at(torch.arange(self.grid.n_vertices, device=self.device)).reshape(self.grid.shape)

    def updated(self, known: Tensor, width: float, vertices: Tensor | None = None) -> Tensor:
        """See `Field.updated`; other vertices are not evaluated."""
        is_wanted = ~(known.abs() > width)  # NaN, too
        if vertices is not None:
            is_wanted[tuple(vertices.to(known.device).unbind(1))] = True
        wanted = is_wanted.nonzero()
        with torch.no_grad():
            return known.index_put(tuple(wanted.unbind(1)), self.values_at(wanted).to(known))

    def values_at(self, vertices: Tensor) -> Tensor:
        """See `Field.values_at`; no other vertex is evaluated."""
        _, n_y, n_z = self.grid.shape
        x, y, z = vertices.to(self.device).unbind(1)
        return self._at((x * n_y + y) * n_z + z)

    def _at(self, index: Tensor) -> Tensor:
        index = index.cpu() if self.device.type == "mps" else index  # positions are float64, which it lacks
        return torch.cat([self.function(self.grid.positions(rows)) for rows in index.split(BATCH_SIZE)])
