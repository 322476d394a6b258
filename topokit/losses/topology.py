"""The topology loss: moves a field until the solid it describes has a given topology."""

from __future__ import annotations

import copy
import sys
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, at_least_single
from topokit.core.grid.field import Field
from topokit.core.grid.tau import typical_step
from topokit.core.homotopy.nearest_solid import Change, Values
from topokit.errors import InputError
from topokit.inputs.calls import options_by_name
from topokit.losses.checks import check_choice, check_count, check_tau
from topokit.losses.field_loss import CountedSolid, FieldLoss, Reduction, batch_shape
from topokit.losses.goal import Goal, betti_rows, goals_of
from topokit.losses.guard import DecisiveVoxels, Guard, Memory
from topokit.losses.memory import Keys, memories, remembered_grid, values_of
from topokit.losses.source import Source

# Slope of a decisive voxel that is off by its margin or more, in margins: at weight 1 it outweighs a mean squared error
# of 500 margins. With benchmarks/topology_tasks.py: a tenth is enough on grids but not for networks, which take ten
# times of it, too.
STIFFNESS = 1000.0
# The same slope for log-odds, whatever their size: that of a cross-entropy is at most 1. Slopes of 1000 margins cost
# two networks 59 and 76 % of their data term, this one at most 4.4 % (docs/topology-loss-measured.md).
LOG_ODDS_SLOPE = 50.0


class TopologyLoss(FieldLoss):
    """Moves a field until its solid has given numbers of components, handles and cavities, or those of a target.

    The loss finds the nearest solid with this topology, and from it the voxels that decide: those that must be on one
    side of the level by a margin τ, and are not. It is a squared error of the field at these voxels, a mean over the
    whole grid like a data term, with slopes that do not grow beyond the margin; so weight 1 is right beside a mean
    squared error. Where values are said to be log-odds, by `logits=True` or `from_occupancy(net, logits=True)`, slopes
    are those that weight 1 is right for beside a mean cross-entropy. This opens, closes, joins, splits and removes; see
    docs/topology-loss.md. The topology is asked for in both connectivities, so that any mesher agrees, unless voxels
    meet through an edge or a corner only, as in noise.

    Args:
        genus: number of handles of the surface (the solid's tunnels), summed over components; or a sequence, one for
            each component of the solid, the largest component first.
        betti: instead of genus, components and cavities: (components, tunnels, cavities); or (components, holes), then
            fields are plane, (..., X, Y). An array of rows (C, 3) is for the channels of a batch (B, C, X, Y, Z).
        at_most: whether fewer are right, too.
        components: of the solid. A sequence of genera has one for each component, and sets this number.
        cavities: of the solid; its surface has components + cavities components.
        plane: whether fields are plane, (..., X, Y); by default what `betti` says.
        change: "any", or whether material may only be added ("add") or only removed ("remove").
        level: of a plain field; {field > level} is the solid. A shape has its own.
        logits: whether a plain field is log-odds; see above. A shape knows.
        search_every: of a field with a key, calls between searches for a nearer solid. In between, the known solid
            follows the field, and of a function only the values near the level are evaluated.
        resolution: for shapes without a field: the most grid points along a side of the winding-number field.
        reduction: "mean", "sum" or "none" over the batch.

    Raises:
        InputError: if an argument has a wrong type or value.

    Example:
        >>> import topokit as tk, torch
        >>> axis = torch.linspace(-1, 1, 32)
        >>> x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
        >>> torus, ball = 0.3 - torch.hypot(torch.hypot(x, y) - 0.5, z), 0.5 - torch.hypot(torch.hypot(x, y), z)
        >>> loss = tk.TopologyLoss(betti=(1, 0, 0))  # a ball: one component, no tunnel, no cavity
        >>> [bool(loss(field) > 0) for field in (torus, ball)]
        [True, False]
    """

    @options_by_name("betti")
    def __init__(
        self,
        genus: int | Sequence[int] | None = None,
        *,
        betti: Any = None,
        at_most: bool = False,
        components: int = 1,
        cavities: int = 0,
        plane: bool | None = None,
        change: Change = "any",
        level: float = 0.0,
        logits: bool = False,
        search_every: int = 20,
        resolution: int = 64,
        reduction: Reduction = "mean",
    ) -> None:
        super().__init__(level, DEFAULT_CONNECTIVITY, resolution, reduction, logits)
        check_choice("change", change, ("any", "add", "remove"))
        check_count("search_every", search_every, 1)
        if genus is not None and betti is not None:
            raise InputError("pass genus, with components and cavities, or betti; not both.")
        self.betti = None if betti is None else betti_rows(betti)
        self.goal = None if genus is None else Goal.of_genus(genus, components, cavities, at_most)
        if self.betti is not None and self.betti.ndim == 1:
            self.goal = Goal(tuple(self.betti.tolist()), at_most=at_most)
        self.at_most = at_most
        self.plane = (betti is not None and np.shape(betti)[-1] == 2) if plane is None else plane
        self.guard = Guard(change, search_every)
        self._known: dict[str | int, Memory] = {}

    def forget(self, *keys: str | int) -> None:
        """Forget what is known of the fields with these keys, of all if none is given."""
        for key in keys or tuple(self._known):
            self._known.pop(key, None)

    def forward(
        self,
        source: Source,
        tau: float | None = None,
        *,
        betti: Any = None,
        target: Tensor | None = None,
        keys: Keys | None = None,
    ) -> Tensor:
        """The loss.

        Args:
            source: (..., X, Y, Z) floating-point field, positive inside, on any device; or a shape with a field
                (from_sdf, from_occupancy, from_voxels), only whose decisive grid points are evaluated with a
                graph; or a shape with oriented samples (points, splats, batches of them), whose
                winding-number field is used.
            tau: distance from the level, in units of the field, that decisive voxels must have; at most the field's
                typical change over one cell, and half of it by default.
            betti: goals of this call, rows that broadcast to the batch, as (B, 3) for a batch (B, X, Y, Z).
            target: a mask like the field (0 is background): its features are wanted, each in its place. Missing ones
                are created, spurious ones removed. To keep a topology, pass the solid of the start.
            keys: what the fields are fields of, one name or number for each. By default every call searches for the
                nearest solid, whatever came before. With a key, the loss remembers what it found for this thing: many
                times faster where one thing is trained step by step.

        Returns:
            0-d tensor, or (...) with reduction "none"; at least single precision; in squared units of the field. Zero
            once the topology is right by that margin, and where no solid of the wanted topology is in reach; then there
            is a warning, too. Differentiable at fixed decisive voxels and at a fixed tau; finite for infinite and
            constant fields.

        Raises:
            InputError: for another kind of source, goals that do not fit, a tau that is not positive, or a field that
                is found to be NaN somewhere; in volumes, NaN is background.
        """
        check_tau(tau)
        if self.plane and isinstance(source, Tensor):
            source = source[..., None]
            target = None if target is None else target[..., None]
        batch = batch_shape(source)
        known = memories(self._known, keys, int(np.prod(batch)))
        found = self.source(source, [remembered_grid(memory) for memory in known])
        decisive = self._decisive([one.field for one in found], tau, betti, target, batch, known)
        losses = [margin_loss(*one, *its) for one, its in zip(found, decisive, strict=True)]
        return self.reduce(torch.stack(losses).reshape(batch))

    def is_met(self, solid: CountedSolid) -> bool:
        """Whether a solid has the wanted topology; False if the loss was made without one for a single field."""
        return self.goal is not None and self.goal.is_met(solid)

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def _decisive(
        self,
        fields: list[Field],
        tau: float | None,
        betti: Any,
        target: Tensor | None,
        batch: tuple[int, ...],
        known: list[Memory],
    ) -> list[tuple[DecisiveVoxels | None, float]]:
        """The voxels that decide about each field, and their margin."""
        if betti is None and target is None and self.goal is None:
            betti = self.betti
        goals = goals_of(self.goal, self.at_most, betti, target, batch, [field.grid.shape for field in fields])
        found = []
        for number, (field, goal, memory) in enumerate(zip(fields, goals, known, strict=True)):
            values = values_of(field, memory, self.guard.search_every)
            on_host = at_least_single(values).cpu().numpy()
            _check_numbers(on_host, f" of batch item {number}" if len(fields) > 1 else "")
            step = typical_step(values)
            margin = step / 2 if tau is None else min(tau, step)
            decisive = self.guard.update(on_host, goal, margin, memory)
            if decisive is not None:
                decisive = DecisiveVoxels(*(part.to(field.device) for part in decisive))
                memory["decisive"] = decisive.voxels
            found.append((decisive, margin))
        unreachable = [number for number, (voxels, _) in enumerate(found) if voxels is None]
        if unreachable:
            self._warn(goals[unreachable[0]], unreachable, batch)
        return found

    def _warn(self, goal: Goal, unreachable: list[int], batch: tuple[int, ...]) -> None:
        where = ""
        if batch:
            items = [tuple(map(int, np.unravel_index(number, batch))) for number in unreachable]
            named = ", ".join(str(item[0] if len(item) == 1 else item) for item in items)
            where = f" for batch item{'s'[: len(items) > 1]} {named}"
        warnings.warn(
            f"no solid with {goal} is in reach{where} (change={self.guard.change!r}): the loss is 0 there. Is the grid "
            "too coarse, is there nothing yet that could become it, or does it need another change?",
            stacklevel=_caller_stacklevel(),
        )

    def _goal_in_words(self) -> str:
        return str(self.goal) if self.betti is None else f"{'at most ' * self.at_most}{self.betti.tolist()}"

    def get_extra_state(self) -> dict[str, Any]:
        """What is known of the fields with keys, for the `state_dict`: tensors, numbers and containers only."""
        return {"goal": self._goal_in_words(), "known": copy.deepcopy(self._known)}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_extra_state` returned.

        Raises:
            InputError: if the state is that of a loss with another goal.
        """
        if state["goal"] != self._goal_in_words():
            raise InputError(
                f"the state is that of a TopologyLoss for {state['goal']}; this one is for {self._goal_in_words()}. "
                "Make the loss with the same goal, or leave its state out."
            )
        self._known = copy.deepcopy(state["known"])


def margin_loss(field: Field, n_terms: float, decisive: DecisiveVoxels | None, margin: float) -> Tensor:
    """Huber loss of the decisive voxels' shortfalls, in squared units of the field, over the number of terms; 0-d.

    That of log-odds is in units of the field.

    Differentiable in the field's values at these voxels. It is zero without any, but has a graph to the field all the
    same, so that `backward` works.
    """
    if decisive is None or len(decisive.voxels) == 0:
        first = field.values_at(torch.zeros(1, 3, dtype=torch.int64, device=field.device))
        return 0 * at_least_single(first).nan_to_num().sum()
    values = at_least_single(field.values_at(decisive.voxels))
    shortfalls = torch.relu(1 - decisive.sides.to(values) * values / margin)
    errors = smooth_l1_loss(shortfalls, torch.zeros_like(shortfalls), reduction="sum")
    slope = LOG_ODDS_SLOPE if field.is_log_odds else STIFFNESS * margin
    return (slope / n_terms) * (margin * errors)


def _check_numbers(values: Values, item: str) -> None:
    """Raise InputError if a field holds NaN: as background it would have the loss 0, however broken the network is."""
    is_nan = np.isnan(values)
    if is_nan.any():
        first = tuple(np.argwhere(is_nan)[0].tolist())
        raise InputError(
            f"the field{item} is NaN at {np.count_nonzero(is_nan)} of {values.size} grid points, the first at "
            f"index {first}. Look for weights that are NaN; where NaN means background, put -inf: "
            "field.masked_fill(field.isnan(), -math.inf)."
        )


def _caller_stacklevel() -> int:
    """Frames from `warnings.warn` up to the first one outside topokit and torch: the line that called the loss."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in ("topokit", "torch"):
        level, frame = level + 1, frame.f_back
    return level


def topology_loss(
    source: Source,
    genus: int | Sequence[int] | None = None,
    tau: float | None = None,
    *,
    betti: Any = None,
    target: Tensor | None = None,
    **options: Any,
) -> Tensor:
    """Functional form of `TopologyLoss`.

    Args:
        source: field, batch of fields or shape; see `TopologyLoss.forward`.
        genus: see `TopologyLoss`.
        tau: margin; see `TopologyLoss.forward`.
        betti: goals, rows that broadcast to the batch; see `TopologyLoss`.
        target: a mask whose topology is wanted in its place; see `TopologyLoss.forward`.
        options: the other arguments of `TopologyLoss`.

    Returns:
        0-d tensor, or (...) with reduction "none".

    Raises:
        InputError: if an argument has a wrong type or value.

    Example:
        >>> import topokit as tk, torch
        >>> ring = torch.ones(5, 5, 3)
        >>> ring[2, 2] = -1.0
        >>> [bool(tk.topology_loss(ring, genus, tau=0.5) > 0) for genus in (0, 1)]
        [True, False]
    """
    return TopologyLoss(genus, betti=betti, **options)(source, tau, target=target)
