"""The Euler loss: how far a field, or a shape that has one, is from a wanted topology."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any, Literal

import torch
from torch import Tensor, nn

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, at_least_single, smoothed_euler
from topokit.core.grid.field import Field, median_step_at_crossings
from topokit.core.homotopy.nearest_solid import Change
from topokit.errors import InputError
from topokit.losses.goal import Target, goal_of
from topokit.losses.guard import Guard, hinge, nothing
from topokit.losses.parts import PartsGuard
from topokit.losses.source import FieldSource, plain_field
from topokit.shape import Shape

Reduction = Literal["mean", "sum", "none"]

_FINEST = 1e-30  # of τ: slopes go with 1 / τ, and single precision has to hold them


class EulerLoss(nn.Module):
    """Asks a field for a topology: by a guard that makes it change, or by (χ_τ − target)² alone.

    With `components` (1 by default) the loss asks for all three Betti numbers of the solid, so that χ = 2 is not met by
    a torus and a stray blob. It is then a guard (`topokit.losses.guard`): the nearest solid of that topology tells
    which voxels decide, and these are pushed. That is what opens, closes, joins, splits and removes.

    With `components=None` it is (χ_τ − target)²: smooth, cheap, and compiled whole where τ is given, but every critical
    point within about τ of the level is pushed, noise and all, which is why χ_τ is no part of the guarded loss unless
    `euler_weight` says so. docs/topology-loss.md tells when which works.

    The module remembers the nearest solid of each batch item from call to call (not in its `state_dict`): use one
    module for each thing that is trained, and `reset()` it before another.

    Args:
        target: Euler characteristic of the surface; or a sequence, one for each component of the solid, the largest
            first.
        genus: instead of the target, the number of handles; or a sequence likewise.
        components: of the solid; None asks for χ alone. A sequence of targets or genera counts them itself.
        cavities: of the solid.
        change: "any", or whether material may only be added ("add") or only removed ("remove").
        level: of a plain field; {field > level} is the solid.
        connectivity: 6 or 26, of χ_τ of a plain field. The guard asks for the topology in both, so that any mesher
            agrees, unless voxels meet through an edge or a corner alone, as in noise.
        euler_weight: of (χ_τ − target)² beside the guard. χ_τ does not know what `change` allows.
        refresh: looks between searches for a nearer solid; in between the known one follows the field.
        look_every: calls between looks at the whole field; in between the voxels last found are pushed. For networks,
            where evaluating the grid is most of a call.
        resolution: grid points along a side, at most, for the winding field of samples.
        reduction: "mean", "sum" or "none" over the batch.

    Raises:
        InputError: if no solid has these numbers, or an option is not known.

    Example:
        >>> import topokit as tk, torch
        >>> axis = torch.linspace(-1, 1, 32)
        >>> x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
        >>> torus, ball = 0.3 - torch.hypot(torch.hypot(x, y) - 0.5, z), 0.5 - torch.hypot(torch.hypot(x, y), z)
        >>> [bool(tk.EulerLoss(genus=0)(field, tau=0.02) > 1) for field in (torus, ball)]
        [True, False]
    """

    def __init__(
        self,
        target: Target = None,
        *,
        genus: int | Sequence[int] | None = None,
        components: int | None = 1,
        cavities: int = 0,
        change: Change = "any",
        level: float = 0.0,
        connectivity: int = DEFAULT_CONNECTIVITY,
        euler_weight: float = 0.0,
        refresh: int = 20,
        look_every: int = 1,
        resolution: int = 64,
        reduction: Reduction = "mean",
    ) -> None:
        super().__init__()
        for name, value, known in (
            ("change", change, ("any", "add", "remove")),
            ("reduction", reduction, ("mean", "sum", "none")),
        ):
            if value not in known:
                raise InputError(f"{name} must be one of {known}, not {value!r}.")
        if refresh < 1 or look_every < 1:
            raise InputError(f"refresh and look_every must be at least 1, got {refresh} and {look_every}.")
        if not 0 <= euler_weight < math.inf:
            raise InputError(f"euler_weight must be finite and not negative, not {euler_weight}.")
        self.goal = goal_of(target, genus, components, cavities)
        if self.goal.betti is None and change != "any":
            raise InputError(f"change={change!r} needs components: χ alone knows no such distinction.")
        self.change: Change = change
        self.euler_weight = euler_weight
        self.refresh = refresh
        self.look_every = look_every
        self.reduction = reduction
        self._source = FieldSource(level, connectivity, resolution)
        self._stacklevel = 4  # of whoever calls the module
        self.reset()

    def reset(self) -> None:
        """Forget the nearest solids."""
        self._guards: list[Guard | PartsGuard] = []
        self._grids: Sequence[object] = ()
        self._seen: list[Tensor] = []
        self._calls = 0

    def forward(self, source: Tensor | Shape, tau: float | None = None) -> Tensor:
        """The loss.

        Args:
            source: (..., X, Y, Z) floating-point field, positive inside, on any device; or a shape with a field
                (from_sdf, from_occupancy, from_voxels: of functions, only the voxels that matter are evaluated with a
                graph), or with oriented samples (points, splats), whose winding field is used.
            tau: how far about the level the loss looks, in units of the field: the scale of χ_τ, and the margin by
                which the guard wants voxels on their side (those farther than the field's typical change over a cell
                are let be). Half that change if None.

        Returns:
            0-d tensor, or (...) with reduction "none"; at least single precision. Differentiable at a fixed choice of
            critical and decisive voxels, and of a tau taken from the field; finite for infinite and constant fields.
            NaN in a plain field gives NaN in χ_τ; to the guard it is background. Slopes go with 1 / tau: a
            float16 field cannot hold them when tau is below about 1e-3.

        Raises:
            InputError: for another kind of source, a tau that is not positive, or no tau where the field has one sign.
        """
        if tau is not None and (
            not isinstance(tau, int | float) or isinstance(tau, bool) or not _FINEST <= tau < math.inf
        ):
            raise InputError(f"tau must be a positive number, not {tau!r}.")
        if self.goal.betti is None and isinstance(source, Tensor) and tau is not None:
            chi = smoothed_euler(plain_field(source), tau, self._source.level, self._source.connectivity)
            return self._reduced((chi - self.goal.euler).square())
        fields = self._source(source)
        is_look = self._look(fields)
        guards: Sequence[Guard | PartsGuard | None] = self._guards or [None] * len(fields)
        losses = [self._one(*item, tau, is_look) for item in zip(fields, self._seen, guards, strict=True)]
        if any(guard is not None and guard.found is None for guard in guards):
            warnings.warn(
                f"no solid with the Betti numbers {self.goal.betti} is in reach (change={self.change!r}), so the guard "
                "is silent. Is the grid too coarse, is there nothing yet that could become them, or do they need "
                "another change?",
                stacklevel=self._stacklevel,
            )
        return self._reduced(torch.stack(losses).reshape(source.shape[:-3] if isinstance(source, Tensor) else ()))

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def _look(self, fields: list[Field]) -> bool:
        """Evaluate the fields without a graph, if it is time; new guards where the grids are others than last time."""
        grids = [field.grid for field in fields]
        is_look = self._calls % self.look_every == 0 or grids != self._grids
        self._calls += 1
        if not is_look:
            return False
        self._seen = [field.detached() for field in fields]
        if grids != self._grids and self.goal.betti is not None:
            self._guards = [self._new_guard() for _ in fields]
        self._grids = grids
        return True

    def _one(
        self, field: Field, seen: Tensor, guard: Guard | PartsGuard | None, tau: float | None, is_look: bool
    ) -> Tensor:
        """The loss of one field, of which was seen what its values are without a graph."""
        tau = max(0.5 * median_step_at_crossings(seen), _FINEST) if tau is None else tau
        if guard is None:
            return (field.smoothed_euler(tau, seen) - self.goal.euler).square()
        guarded = self._guarded(field, seen, guard, tau, is_look)
        if not self.euler_weight:
            return guarded
        return guarded + self.euler_weight * (field.smoothed_euler(tau, seen) - self.goal.euler).square()

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def _guarded(self, field: Field, seen: Tensor, guard: Guard | PartsGuard, tau: float, is_look: bool) -> Tensor:
        found = guard.decisive(at_least_single(seen).cpu().numpy(), tau) if is_look else guard.found
        return nothing(field) if found is None else hinge(field, found, tau)

    def _new_guard(self) -> Guard | PartsGuard:
        assert self.goal.betti is not None
        if self.goal.parts:
            return PartsGuard(self.goal.parts, self.change, self.refresh)
        return Guard(self.goal.betti, self.change, self.refresh)

    def _reduced(self, losses: Tensor) -> Tensor:
        if self.reduction == "none":
            return losses
        return losses.mean() if self.reduction == "mean" else losses.sum()


def euler_loss(source: Tensor | Shape, target: Target = None, tau: float | None = None, **options: Any) -> Tensor:
    """`EulerLoss(target, **options)(source, tau)`, which see; it remembers nothing, so it searches at every call.

    Example:
        >>> import topokit as tk, torch
        >>> noise = torch.randn(2, 8, 8, 8, generator=torch.Generator().manual_seed(0))
        >>> tk.euler_loss(noise, target=2.0, tau=0.1, components=None, reduction="none").shape
        torch.Size([2])
    """
    loss = EulerLoss(target, **options)
    loss._stacklevel += 1
    return loss(source, tau)
