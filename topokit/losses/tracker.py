"""Tracks what decides about the fields of a batch from call to call, as losses need it in training."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from topokit.core.grid.euler import at_least_single
from topokit.core.grid.field import Field, default_tau
from topokit.core.grid.grid import Grid
from topokit.core.homotopy.nearest_solid import Values
from topokit.errors import InputError
from topokit.losses.checks import check_count
from topokit.losses.guard import ComponentGuard, Guard
from topokit.losses.memory import KnownValues, Memory


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


Found = tuple[Tensor, Tensor]
"""Grid vertices (M, 3) that decide about a field, and a weight (M,) for each."""


class Track(Memory, ABC):
    """What decides about one field, as of its last evaluation.

    Attributes:
        found: the deciding vertices, or None if there are none in reach; on the device of the field.
        default_tau: the default τ of the field if the last evaluation needed it, else None.
    """

    remembers: ClassVar[tuple[str, ...]] = ("known", "found", "default_tau")

    def __init__(self, search_every: int) -> None:
        """Args: search_every: evaluations from one of all values of a function to the next."""
        self.known = KnownValues(search_every)
        self.found: Found | None = None
        self.default_tau: float | None = None

    @abstractmethod
    def update(self, field: Field, tau: float | None, item: str) -> None:
        """Evaluate the field as it is now.

        Args:
            field: on the same grid in every call.
            tau: scale of the levels, in units of the field; None for `default_tau`.
            item: names the field in error messages; empty if it is the only one.
        """

    def _tau(self, values: Tensor, tau: float | None) -> float:
        self.default_tau = default_tau(values) if tau is None else None
        return tau or self.default_tau or 0.0


class CriticalTrack(Track):
    """The critical vertices of a field and their index, for the Euler loss."""

    def update(self, field: Field, tau: float | None, item: str) -> None:
        """See `Track.update`."""
        values = self.known.update(field, tau)
        self._tau(values, tau)
        self.found = field.critical_vertices(values)


class SolidTrack(Track):
    """The decisive voxels of a field and their sides, for the topology loss."""

    remembers = (*Track.remembers, "guard")

    def __init__(self, guard: Guard | ComponentGuard, search_every: int) -> None:
        """Args: guard: of this field; search_every: as for `Track`."""
        super().__init__(search_every)
        self.guard = guard

    def update(self, field: Field, tau: float | None, item: str) -> None:
        """See `Track.update`; raises InputError if the field is NaN somewhere."""
        # not as far as τ reaches: margins end within a cell of the level, and beyond it only decisive voxels move
        values = self.known.update(field, None, None if self.found is None else self.found[0])
        on_host = at_least_single(values).cpu().numpy()
        _check_numbers(on_host, item)
        decisive = self.guard.update(on_host, self._tau(values, tau))
        self.found = decisive and (decisive.voxels, decisive.sides)


class Tracker(nn.Module):
    """A track for each field of a batch, updated every few calls. Its memory is in the `state_dict`."""

    def __init__(self, options: SearchOptions, make_track: Callable[[], Track], goal: object = None) -> None:
        """Args: options: how often to do what; make_track: of a new field; goal: what the tracks are for."""
        super().__init__()
        self.options, self.goal, self._make_track = options, goal, make_track
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._start([])

    def _start(self, grids: list[Grid]) -> None:
        """New tracks for fields on these grids."""
        self._grids = grids
        self._tracks = [self._make_track() for _ in grids]
        self._n_calls = 0

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def forward(self, fields: list[Field], tau: float | None) -> list[tuple[Found | None, float]]:
        """What decides about each field, and the τ to take: the given one, or the default of the field."""
        grids = [field.grid for field in fields]
        if grids != self._grids:
            self._start(grids)
        lacks_tau = tau is None and any(track.default_tau is None for track in self._tracks)
        if self._n_calls % self.options.evaluate_every == 0 or lacks_tau:
            for number, (track, field) in enumerate(zip(self._tracks, fields, strict=True)):
                track.update(field, tau, f" of batch item {number}" if len(fields) > 1 else "")
        for track, field in zip(self._tracks, fields, strict=True):
            track.found = track.found and (track.found[0].to(field.device), track.found[1].to(field.device))
        self._n_calls += 1  # an evaluation that failed is still due
        return [(track.found, tau or track.default_tau or 0.0) for track in self._tracks]

    def get_extra_state(self) -> dict[str, Any]:
        """What has been found so far, for the `state_dict`: tensors, numbers and containers only."""
        tracks = [track.get_state() for track in self._tracks]
        grids = [asdict(grid) for grid in self._grids]
        return {"goal": self.goal, "grids": grids, "tracks": tracks, "n_calls": self._n_calls}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_extra_state` returned.

        Raises:
            InputError: if the state is that of a loss with another goal.
        """
        if state["goal"] != self.goal:
            raise InputError(
                f"the state is that of a TopologyLoss for Betti numbers, by component, and change {state['goal']}; "
                f"this one is for {self.goal}. Make the loss with the same goal, or leave its state out."
            )
        self._start([Grid(**grid) for grid in state["grids"]])
        for track, its in zip(self._tracks, state["tracks"], strict=True):
            track.set_state(its)
        self._n_calls = state["n_calls"]


def _check_numbers(values: Values, item: str) -> None:
    """Raise InputError if a field holds NaN: as background it would have the loss 0, however broken the network is."""
    is_nan = np.isnan(values)
    if is_nan.any():
        first = tuple(np.argwhere(is_nan)[0].tolist())
        raise InputError(
            f"the field{item} is NaN at {np.count_nonzero(is_nan)} of {values.size} grid points, the first at "
            f"index {first}. Track for weights that are NaN; where NaN means background, put -inf: "
            "field.masked_fill(field.isnan(), -math.inf)."
        )
