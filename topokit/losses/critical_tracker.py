"""Tracks the critical vertices of a function's field from call to call, as the Euler loss needs them in training."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import torch
from torch import Tensor, nn

from topokit.core.grid.field import Field, default_tau
from topokit.core.grid.grid import Grid
from topokit.losses.known_values import KnownValues
from topokit.losses.tracker import SearchOptions


class CriticalTracker(nn.Module):
    """χ_τ of one field at the critical vertices last found. Its memory is in the `state_dict`."""

    def __init__(self, options: SearchOptions) -> None:
        """Args: options: how often to evaluate what."""
        super().__init__()
        self.options = options
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._start(None)

    def _start(self, grid: Grid | None) -> None:
        self._grid = grid
        self._known = KnownValues(self.options.search_every)
        self._critical: tuple[Tensor, Tensor] | None = None  # vertices and their index
        self._default_tau: float | None = None
        self._n_calls = 0

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def forward(self, field: Field, tau: float | None) -> Tensor:
        """χ_τ, 0-d; differentiable in the values at the critical vertices."""
        if field.grid != self._grid:
            self._start(field.grid)
        is_due = self._n_calls % self.options.evaluate_every == 0 or (tau is None and self._default_tau is None)
        self._n_calls += 1
        if is_due or self._critical is None:
            values = self._known.update(field, tau)
            self._default_tau = default_tau(values) if tau is None else None
            self._critical = field.critical_vertices(values)
        vertices, index = (part.to(field.device) for part in self._critical)
        return field.weighted_sum(vertices, index, tau or self._default_tau or 0.0)

    def get_extra_state(self) -> dict[str, Any]:
        """What has been found so far, for the `state_dict`: tensors, numbers and containers only."""
        return {
            "grid": None if self._grid is None else asdict(self._grid),
            "known": self._known.get_state(),
            "critical": self._critical,
            "default_tau": self._default_tau,
            "n_calls": self._n_calls,
        }

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_extra_state` returned."""
        self._start(None if state["grid"] is None else Grid(**state["grid"]))
        self._known.set_state(state["known"])
        self._critical, self._default_tau, self._n_calls = state["critical"], state["default_tau"], state["n_calls"]
