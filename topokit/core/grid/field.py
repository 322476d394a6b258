"""Scalar fields on grids, and the smoothed Euler characteristic whose gradient changes topology."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from topokit.core.grid.euler import (
    DEFAULT_CONNECTIVITY,
    at_least_single,
    check_connectivity,
    critical_index,
    smoothed_euler,
    surface_euler,
)
from topokit.core.grid.grid import Grid
from topokit.core.grid.tau import default_tau
from topokit.core.residence import stays_on_device
from topokit.errors import InputError


class Field(ABC):
    """A scalar field on a regular grid, positive inside the solid, and background outside the grid.

    A subclass defines `values`. Where single values are cheaper than all of them with a graph, it overrides `values_at`
    too.

    Attributes:
        grid: its geometry.
        connectivity: 6 or 26, that of the solid; the background has the other one.
        is_costly: whether values are computed when they are asked for, so that a few are much cheaper than all.
        is_binary: whether the values say no more than what is inside.
        is_log_odds: whether they are log-odds, so that a data term beside is a cross-entropy.

    Raises:
        InputError: for another connectivity.
    """

    is_costly = False
    is_binary = False
    is_log_odds = False

    def __init__(self, grid: Grid, connectivity: int) -> None:
        self.grid = grid
        self.connectivity = check_connectivity(connectivity)

    @abstractmethod
    def values(self) -> Tensor:
        """The field (X, Y, Z) minus its level: positive inside, differentiable in what the shape was made from."""

    @property
    @abstractmethod
    def device(self) -> torch.device:
        """Where the values are."""

    def detached(self) -> Tensor:
        """The values without a graph."""
        with torch.no_grad():
            return self.values().detach()

    def gray_values(self) -> tuple[Tensor, float]:
        """The field (X, Y, Z) in its own units without a graph, and its level in these."""
        return self.detached(), 0.0

    def values_at(self, vertices: Tensor) -> Tensor:
        """The values at grid vertices (M, 3) int64, as (M,); differentiable as `values` is."""
        x, y, z = vertices.unbind(1)
        return self.values()[x, y, z]

    def updated(self, known: Tensor, width: float, vertices: Tensor | None = None) -> Tensor:
        """The values (X, Y, Z) as they are now, without a graph; far from the level they may be the known ones.

        Args:
            known: values at an earlier time.
            width: distance from the level up to which known values are not trusted.
            vertices: (M, 3) int64, grid vertices at which they are not trusted either.
        """
        return self.detached()

    def exact_euler(self, connectivity: int | None = None) -> Tensor:
        """χ of the surface of {values > 0}, a 0-d int64 tensor; in the field's own connectivity if None is given."""
        return surface_euler(self.detached(), connectivity=connectivity or self.connectivity)

    def smoothed_euler(self, tau: float | None = None, values: Tensor | None = None) -> Tensor:
        """χ_τ of the surface on the field's own grid and in its own connectivity (see `euler.smoothed_euler`).

        χ_τ depends only on the values at critical vertices, so only these are evaluated with a graph. To find them is a
        look at the device: on accelerators all known values are summed instead, if τ is given.

        Args:
            tau: scale of the levels, in units of the field; `default_tau` if None. 0 gives the exact integer of the
                grid, without a gradient.
            values: what `detached` returns, if it is known already.

        Returns:
            0-d tensor, differentiable for τ > 0.

        Raises:
            InputError: if τ is negative or not finite.
        """
        if tau is not None and not 0 <= tau < float("inf"):
            raise InputError(f"tau must be a positive number (or 0 for the exact integer of the grid), got {tau}.")
        if tau == 0:
            return self.exact_euler()
        if tau is not None and not self.is_costly and stays_on_device(self.device):
            return smoothed_euler(self.values(), tau, connectivity=self.connectivity)
        values = self.detached() if values is None else values
        tau = default_tau(values) if tau is None else tau
        return self.weighted_sum(*self.critical_vertices(values), tau)

    def critical_vertices(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Grid vertices (M, 3) that have a share in χ_τ, and their critical index (M,), for these values."""
        index = critical_index(values, self.connectivity)
        counts = (index != 0) | values.isnan()  # NaN gives NaN, as everywhere
        return counts.nonzero(), index[counts]

    def weighted_sum(self, vertices: Tensor, index: Tensor, tau: float) -> Tensor:
        """χ_τ from what `critical_vertices` returns, 0-d; differentiable in the values there."""
        return 2 * (index * torch.sigmoid(at_least_single(self.values_at(vertices)) / tau)).sum()


class GridField(Field):
    """A field given by its values (X, Y, Z), level subtracted, on a grid of unit cells unless stated otherwise."""

    def __init__(
        self,
        values: Tensor,
        grid: Grid | None = None,
        connectivity: int = DEFAULT_CONNECTIVITY,
        is_log_odds: bool = False,
    ) -> None:
        x, y, z = values.shape
        super().__init__(grid or Grid((x, y, z)), connectivity)
        self._values, self.is_log_odds = values, is_log_odds

    @property
    def device(self) -> torch.device:
        """See `Field.device`."""
        return self._values.device

    def values(self) -> Tensor:
        """See `Field.values`."""
        return self._values
