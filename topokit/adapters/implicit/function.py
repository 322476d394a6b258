"""A user's callable as a field that is positive inside: where it computes, what it returns, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from topokit.core.grid.euler import solid_euler
from topokit.core.grid.field import Field, checked_tau, default_tau
from topokit.core.linalg import normalize
from topokit.errors import InputError

Function = Callable[[Tensor], Tensor]
_PROBE = 5  # points of the first call; an odd number that is neither 1 nor 3, so that shapes are told apart


class LevelFunction:
    """F = sign · (f − level), positive inside, evaluated where and in what type f wants it.

    Args:
        f: maps (N, 3) tensors to (N,) or (N, 1).
        level: value of f on the surface.
        sign: +1 where f is high inside, −1 where it is low inside.
        name: what to call f in errors.
        probe: (m, 3) positions for the first call.

    Raises:
        InputError: if f cannot be called with points of any common type and device, or returns something else than
            one finite number per point.
    """

    def __init__(self, f: Function, level: float, sign: int, name: str, probe: Tensor) -> None:
        self.f, self.level, self.sign, self.name = f, level, sign, name
        self.dtype, self.device = self._home(probe)
        self.n_evaluations = 0

    def __call__(self, points: Tensor) -> Tensor:
        """Values (N,) at positions (N, 3), with a graph to points and weights where gradients are on.

        Raises:
            InputError: on a wrong shape or NaN, naming the point.
        """
        asked = points.to(self.device, self.dtype)
        self.n_evaluations += len(asked)
        values = self.sign * (self._checked_shape(self.f(asked), len(asked)) - self.level)
        broken = values.detach().isnan()
        if broken.any():
            where = ", ".join(f"{x:.4g}" for x in asked[broken][0].tolist())
            raise InputError(
                f"{self.name} is NaN at {int(broken.sum())} of {len(asked)} points, the first at ({where}): look for a "
                "division by zero or a root of a negative number there, or for weights that are NaN."
            )
        return values

    def without_graph(self, points: Tensor) -> Tensor:
        """Values (N,), detached."""
        with torch.no_grad():
            return self(points)

    def value_and_gradient(self, points: Tensor, create_graph: bool = False) -> tuple[Tensor, Tensor]:
        """Values (N,) and spatial gradients (N, 3); detached unless `create_graph`.

        The gradient is zero where f does not depend on the points by way of torch.
        """
        with torch.enable_grad():
            at = points if create_graph and points.requires_grad else points.detach().requires_grad_(True)
            values = self(at)
            gradient = None
            if values.requires_grad:
                gradient = torch.autograd.grad(values.sum(), at, create_graph=create_graph, allow_unused=True)[0]
        if gradient is None:
            gradient = torch.zeros_like(points)
        return (values, gradient) if create_graph else (values.detach(), gradient)

    def hessian(self, points: Tensor) -> Tensor:
        """Second derivatives (N, 3, 3), detached: one backward pass per row over the graph of the gradient."""
        with torch.enable_grad():
            at = points.detach().requires_grad_(True)
            gradient = torch.autograd.grad(self(at).sum(), at, create_graph=True)[0]
            rows = [
                torch.autograd.grad(gradient[:, axis].sum(), at, retain_graph=True, allow_unused=True)[0]
                if gradient.requires_grad
                else None
                for axis in range(3)
            ]
        return torch.stack([torch.zeros_like(points) if row is None else row for row in rows], dim=-2).detach()

    def _home(self, probe: Tensor) -> tuple[torch.dtype, torch.device]:
        """The type and device that f computes in: those of its weights, else the first that it accepts."""
        tried: list[str] = []
        for dtype, device in _candidates(self.f):
            try:
                with torch.no_grad():
                    answer = self.f(probe.to(device, dtype))
            except (RuntimeError, TypeError, ValueError, IndexError, AttributeError) as error:
                said = " ".join(str(error).split())[:200]
                tried.append(f"{dtype} on {device}: {type(error).__name__}: {said}")
                continue
            self._checked_shape(answer, len(probe))
            return dtype, device
        raise InputError(
            f"{self.name} cannot be called with a tensor of points ({len(probe)}, 3); expected a callable that maps "
            f"(N, 3) to (N,) or (N, 1). It said, with {tried[0]}."
        )

    def _checked_shape(self, answer: object, n_points: int) -> Tensor:
        if not isinstance(answer, Tensor):
            raise InputError(f"{self.name} returns {type(answer).__name__}; expected a tensor (N,) or (N, 1).")
        if tuple(answer.shape) not in ((n_points,), (n_points, 1)):
            raise InputError(
                f"{self.name} maps points ({n_points}, 3) to shape {tuple(answer.shape)}; expected ({n_points},) or "
                f"({n_points}, 1), one number per point. Of several outputs pass one: lambda x: f(x)[:, 0]."
            )
        answer = answer.reshape(n_points)
        return answer if answer.is_floating_point() else answer.to(torch.get_default_dtype())


def _candidates(f: Function) -> list[tuple[torch.dtype, torch.device]]:
    if isinstance(f, torch.nn.Module):
        for tensor in (*f.parameters(), *f.buffers()):
            if tensor.is_floating_point():
                return [(tensor.dtype, tensor.device)]
    devices = [torch.device("cpu")] + ([torch.device("cuda")] if torch.cuda.is_available() else [])
    return [
        (dtype, device) for device in devices for dtype in (torch.get_default_dtype(), torch.float32, torch.float64)
    ]


class FunctionField(Field):
    """A function on a grid of its own.

    χ_τ depends on the values at critical grid points alone, so only these are evaluated with a graph: exact, and the
    memory is that of a few thousand points.

    Args:
        function: positive inside.
        low, high: corners of the box.
        n_cells: cells along the longest side.
        connectivity: 6 or 26.
    """

    _CHUNK = 1 << 16

    def __init__(
        self,
        function: LevelFunction,
        low: tuple[float, float, float],
        high: tuple[float, float, float],
        n_cells: int,
        connectivity: int,
    ) -> None:
        sides = [b - a for a, b in zip(low, high, strict=True)]
        cells = [max(8, round(n_cells * side / max(sides))) for side in sides]
        spacing = (sides[0] / cells[0], sides[1] / cells[1], sides[2] / cells[2])
        super().__init__(low, spacing, tuple(count + 1 for count in cells), connectivity)
        self.function = function

    def positions(self) -> Tensor:
        """Grid points (X · Y · Z, 3), float64."""
        axes = [
            start + step * torch.arange(count, dtype=torch.float64)
            for start, step, count in zip(self.origin, self.spacing, self.shape, strict=True)
        ]
        return torch.cartesian_prod(*axes)

    def values(self) -> Tensor:
        """F (X, Y, Z), positive inside; with a graph to the weights where gradients are on."""
        parts = [self.function(points) for points in torch.split(self.positions(), self._CHUNK)]
        return torch.cat(parts).reshape(self.shape)

    def values_at(self, voxels: Tensor) -> Tensor:
        """See `Field.values_at`; no other grid point is evaluated."""
        _, n_y, n_z = self.shape
        x, y, z = voxels.cpu().unbind(1)
        positions = self.positions()[(x * n_y + y) * n_z + z]
        parts = [self.function(points) for points in torch.split(positions, self._CHUNK)]
        return torch.cat(parts)

    def exact_euler(self) -> Tensor:
        """See `Field.exact_euler`."""
        return 2 * solid_euler(self.detached(), connectivity=self.connectivity)

    def smoothed_euler(self, tau: float, values: Tensor | None = None) -> Tensor:
        """See `Field.smoothed_euler`."""
        return super().smoothed_euler(tau, self.detached() if values is None else values)

    def euler(self, tau: float | None = None) -> Tensor:
        """See `Field.euler`; the grid is evaluated once, whether or not τ is given."""
        values = self.detached()
        tau = checked_tau(default_tau(values) if tau is None else tau)
        return self.smoothed_euler(tau, values) if tau > 0 else 2 * solid_euler(values, connectivity=self.connectivity)


def outward(gradient: Tensor, otherwise: Tensor) -> Tensor:
    """Unit normals −∇F/|∇F|; where the gradient vanishes, the others."""
    flat = (gradient.detach() == 0).all(-1, keepdim=True)
    return torch.where(flat, otherwise, normalize(torch.where(flat, otherwise, -gradient)))
