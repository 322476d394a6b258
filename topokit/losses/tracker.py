"""Tracks the nearest solids of a batch of fields from call to call, as the topology loss needs them in training."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from torch import nn

from topokit.core.grid.euler import at_least_single
from topokit.core.grid.field import Field, default_tau
from topokit.core.grid.grid import Grid
from topokit.core.homotopy.nearest_solid import Change, Values
from topokit.errors import InputError
from topokit.losses.checks import check_count
from topokit.losses.component_guard import ComponentGuard
from topokit.losses.goal import Goal
from topokit.losses.guard import DecisiveVoxels, Guard
from topokit.losses.known_values import KnownValues


@dataclass(frozen=True)
class SearchOptions:
    """How often `TopologyLoss` does its two expensive steps.

    Attributes:
        search_every: evaluations of the field between searches for a nearer solid. In between, the known solid follows
            the field, and of a function only the values near the level are evaluated.
        evaluate_every: calls between evaluations of the whole field. In between, the decisive voxels last found are
            used. For networks, where evaluating the grid is most of a call.

    Raises:
        InputError: if one of them is not an integer of at least 1.
    """

    search_every: int = 20
    evaluate_every: int = 1

    def __post_init__(self) -> None:
        check_count("search_every", self.search_every, 1)
        check_count("evaluate_every", self.evaluate_every, 1)


def checked_search(search: object) -> SearchOptions:
    """The options themselves.

    Raises:
        InputError: if they are something else.
    """
    if not isinstance(search, SearchOptions):
        raise InputError(f"search must be a SearchOptions, not {search!r}.")
    return search


class SolidTracker(nn.Module):
    """One guard for each field of a batch, and when to show them the fields. Its memory is in the `state_dict`."""

    def __init__(self, goal: Goal, change: Change, options: SearchOptions) -> None:
        """Args: goal: wanted topology; change: see `nearest_solid`; options: how often to do what."""
        super().__init__()
        self.goal = goal
        self.change: Change = change
        self.options = options
        self.reset()

    def reset(self) -> None:
        """Forget the nearest solids."""
        self._start([])

    def _start(self, grids: list[Grid]) -> None:
        """New guards for fields on these grids."""
        self._grids = grids
        self._guards = [self._new_guard() for _ in grids]
        self._values = [KnownValues(self.options.search_every) for _ in grids]
        self._decisive: list[DecisiveVoxels | None] = []  # those of the guards, on the devices of their fields
        self._default_taus: list[float] = []
        self._n_calls = 0

    def _new_guard(self) -> Guard | ComponentGuard:
        if self.goal.by_component:
            return ComponentGuard(self.goal.by_component, self.change, self.options.search_every)
        return Guard(self.goal.betti, self.change, self.options.search_every)

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def forward(self, fields: list[Field], tau: float | None) -> list[tuple[DecisiveVoxels | None, float]]:
        """The decisive voxels of each field, None where no wanted solid is in reach, and their margin."""
        grids = [field.grid for field in fields]
        if grids != self._grids:
            self._start(grids)
        is_due = self._n_calls % self.options.evaluate_every == 0 or (tau is None and not self._default_taus)
        if is_due:
            self._look(fields, tau)
        elif not self._decisive:
            self._keep_decisive(fields)
        self._n_calls += 1  # a look that failed is still due
        margins = self._default_taus if tau is None else [tau] * len(fields)
        return list(zip(self._decisive, margins, strict=True))

    def _look(self, fields: list[Field], tau: float | None) -> None:
        """Show the fields to their guards."""
        values = [
            # not as far as τ reaches: margins end within a cell of the level, and beyond it only decisive voxels move
            known.update(field, None, guard.decisive and guard.decisive.voxels)
            for known, field, guard in zip(self._values, fields, self._guards, strict=True)
        ]
        on_host = [at_least_single(one).cpu().numpy() for one in values]
        _check_numbers(on_host)
        self._default_taus = [default_tau(one) for one in values] if tau is None else []
        margins = self._default_taus if tau is None else [tau] * len(fields)
        for guard, one, margin in zip(self._guards, on_host, margins, strict=True):
            guard.update(one, margin)
        self._keep_decisive(fields)

    def _keep_decisive(self, fields: list[Field]) -> None:
        self._decisive = [
            guard.decisive and DecisiveVoxels(*(part.to(field.device) for part in guard.decisive))
            for guard, field in zip(self._guards, fields, strict=True)
        ]

    def get_extra_state(self) -> dict[str, Any]:
        """What has been found so far, for the `state_dict`: tensors, numbers and containers only."""
        return {
            "goal": (self.goal.betti, self.goal.by_component, self.change),
            "grids": [asdict(grid) for grid in self._grids],
            "guards": [guard.get_state() for guard in self._guards],
            "values": [known.get_state() for known in self._values],
            "default_taus": self._default_taus,
            "n_calls": self._n_calls,
        }

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_extra_state` returned.

        Raises:
            InputError: if the state is that of a loss with another goal.
        """
        goal = self.goal.betti, self.goal.by_component, self.change
        if state["goal"] != goal:
            raise InputError(
                f"the state is that of a TopologyLoss for Betti numbers, by component, and change {state['goal']}; "
                f"this one is for {goal}. Make the loss with the same goal, or leave its state out."
            )
        self._start([Grid(**grid) for grid in state["grids"]])
        for guard, own in zip(self._guards, state["guards"], strict=True):
            guard.set_state(own)
        for known, its in zip(self._values, state["values"], strict=True):
            known.set_state(its)
        self._default_taus, self._n_calls = state["default_taus"], state["n_calls"]


def _check_numbers(fields: list[Values]) -> None:
    """Raise InputError if a field holds NaN: as background it would have the loss 0, however broken the network is."""
    for number, values in enumerate(fields):
        is_nan = np.isnan(values)
        if is_nan.any():
            first = tuple(np.argwhere(is_nan)[0].tolist())
            item = f" of batch item {number}" if len(fields) > 1 else ""
            raise InputError(
                f"the field{item} is NaN at {np.count_nonzero(is_nan)} of {values.size} grid points, the first at "
                f"index {first}. Look for weights that are NaN; where NaN means background, put -inf: "
                "field.masked_fill(field.isnan(), -math.inf)."
            )
