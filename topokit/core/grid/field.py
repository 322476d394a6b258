"""A shape that is given by a field: values on a grid, and the smoothed Euler characteristic that moves topology."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, at_least_single, critical_index, smoothed_euler, solid_euler
from topokit.errors import InputError

SMALLEST_TAU = 1e-30  # slopes go with 1 / τ, and single precision has to hold them


class Field(ABC):
    """A scalar field on a regular grid, positive inside the solid, and background outside the grid.

    A subclass gives `values`; where they are cheaper one by one than all with a graph it overrides `detached`,
    `values_at` and `smoothed_euler`, too.

    Attributes:
        origin: position of the first grid point, (x, y, z), in units of length.
        spacing: step along each axis, in units of length.
        shape: grid points along each axis.
        connectivity: 6 or 26, that of the solid; the background has the other one.
    """

    def __init__(
        self,
        origin: tuple[float, float, float],
        spacing: tuple[float, float, float],
        shape: tuple[int, ...],
        connectivity: int,
    ) -> None:
        if connectivity not in (6, 26):
            raise InputError(f"connectivity must be 6 or 26, got {connectivity!r}.")
        self.origin = origin
        self.spacing = spacing
        self.shape = shape
        self.connectivity = connectivity

    @abstractmethod
    def values(self) -> Tensor:
        """The field (X, Y, Z) minus its level: positive inside, differentiable in what the shape was made from."""

    def detached(self) -> Tensor:
        """The values without a graph."""
        with torch.no_grad():
            return self.values().detach()

    def values_at(self, voxels: Tensor) -> Tensor:
        """The values at grid points (M, 3) int64, as (M,); differentiable as `values` is."""
        x, y, z = voxels.unbind(1)
        return self.values()[x, y, z]

    def smoothed_euler(self, tau: float, values: Tensor | None = None) -> Tensor:
        """χ_τ of the surface, see `topokit.core.grid.euler.smoothed_euler`; differentiable.

        Args:
            tau: scale of the levels.
            values: what `detached` returns, if it is at hand: then only the critical grid points, which are all that
                χ_τ depends on, are evaluated with a graph.
        """
        if values is None:
            return smoothed_euler(self.values(), tau, connectivity=self.connectivity)
        index = critical_index(values, self.connectivity)
        counts = (index != 0) | values.isnan()  # NaN gives NaN, as everywhere
        critical = at_least_single(self.values_at(counts.nonzero()))
        return 2 * (index[counts] * torch.sigmoid(critical / tau)).sum()

    def exact_euler(self) -> Tensor:
        """χ of the surface of {values > 0} on the grid: the limit of χ_τ as τ → 0, a 0-d int64 tensor."""
        return 2 * solid_euler(self.values(), connectivity=self.connectivity)

    def euler(self, tau: float | None = None) -> Tensor:
        """χ_τ of the field on its own grid, in its own connectivity.

        Args:
            tau: scale of the levels, in units of the field; `default_tau` if None. 0 gives the exact integer of
                the grid, without a gradient.

        Returns:
            0-d tensor, differentiable for τ > 0.

        Raises:
            InputError: if τ is negative or not finite.
        """
        tau = checked_tau(default_tau(self.detached()) if tau is None else tau)
        return self.smoothed_euler(tau) if tau > 0 else self.exact_euler()


class GridField(Field):
    """A field that is its values on the grid (X, Y, Z), level subtracted."""

    def __init__(
        self,
        values: Tensor,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        spacing: tuple[float, float, float] = (1.0, 1.0, 1.0),
        connectivity: int = DEFAULT_CONNECTIVITY,
    ) -> None:
        super().__init__(origin, spacing, tuple(values.shape), connectivity)
        self._values = values

    def values(self) -> Tensor:
        """See `Field.values`."""
        return self._values


def euler_of_field(field: Field | None, tau: float | None, name: str) -> Tensor:
    """`field.euler(tau)`.

    Raises:
        InputError: if there is no field, or τ makes no sense.
    """
    if field is None:
        raise InputError(f"{name} has no field, so method='field' cannot be used: use 'gauss-bonnet'.")
    return field.euler(tau)


def checked_tau(tau: float) -> float:
    """τ itself.

    Raises:
        InputError: if it is negative or not finite.
    """
    if not 0 <= tau < float("inf"):
        raise InputError(f"tau must be a positive number (or 0 for the exact integer of the grid), got {tau}.")
    return tau


def default_tau(values: Tensor) -> float:
    """The default of τ everywhere: half the typical change of a field over one cell at its zero crossings.

    Args:
        values: (X, Y, Z), level subtracted.

    Raises:
        InputError: if all values have the same sign, so that nothing crosses zero.
    """
    return max(0.5 * median_step_at_crossings(values), SMALLEST_TAU)


def median_step_at_crossings(values: Tensor) -> float:
    """Median of |F(b) − F(a)| over the grid edges ab along which the field (X, Y, Z) changes its sign.

    Raises:
        InputError: if there is no such edge.
    """
    steps = []
    for axis in range(3):
        n = values.shape[axis]
        lower, upper = values.narrow(axis, 0, n - 1), values.narrow(axis, 1, n - 1)
        crossing = (lower > 0) != (upper > 0)
        steps.append((at_least_single(upper[crossing]) - at_least_single(lower[crossing])).abs())
    found = torch.cat(steps)
    found = found[found.isfinite()]
    if len(found) == 0:
        raise InputError(
            "the field has the same sign at all points of its grid, so it has no typical change: pass tau."
        )
    return float(found.median())
