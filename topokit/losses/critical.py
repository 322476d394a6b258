"""Critical points of a field: which voxels the Euler loss moves, in which direction, and what happens there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, at_least_single, critical_index, smoothed_euler
from topokit.core.homotopy.simple_points import OFFSETS, Codes, count_touching
from topokit.errors import InputError

APPEARS, FILLS, JOINS, CLOSES, SEVERAL = "appears", "fills", "joins", "closes", "several"


@dataclass(frozen=True)
class CriticalPoints:
    """Voxels at which the topology of {field > t} changes as t falls past their value, sorted by |value|.

    Attributes:
        voxels: (M, 3) int64 grid indices (x, y, z).
        values: (M,), field minus level.
        index: (M,) int64, change of the solid's Euler characteristic.
        kinds: what happens there as the level falls: "appears" (a part), "joins" (parts join, or a handle closes on
            itself and a tunnel opens), "closes" (a tunnel closes or a cavity is walled off), "fills" (a cavity
            vanishes), or "several" of these at once.
        push: (M,), minus the derivative of (χ_τ - target)² with respect to the field: positive where gradient descent
            raises the field.
    """

    voxels: Tensor
    values: Tensor
    index: Tensor
    kinds: tuple[str, ...]
    push: Tensor


def critical_points(
    field: Tensor,
    target: float,
    tau: float,
    *,
    level: float = 0.0,
    connectivity: int = DEFAULT_CONNECTIVITY,
) -> CriticalPoints:
    """Critical points of a field, and how (χ_τ - target)² pushes them.

    Args:
        field: (X, Y, Z), floating point, positive inside, finite.
        target: Euler characteristic of the surface.
        tau: scale of the levels over which χ is averaged, in units of the field.
        level: {field > level} is the solid.
        connectivity: 6 or 26, that of the solid.

    Raises:
        InputError: if the field is not one finite floating-point grid, or tau is not positive.
    """
    if field.ndim != 3 or not field.is_floating_point() or not bool(field.isfinite().all()):
        raise InputError(
            "critical points need one finite floating-point field (X, Y, Z); got shape "
            f"{tuple(field.shape)} and type {field.dtype}."
        )
    leaf = at_least_single(field.detach()).clone().requires_grad_()
    with torch.enable_grad():
        loss = (smoothed_euler(leaf, tau, level, connectivity) - target).square()
    (slope,) = torch.autograd.grad(loss, leaf)
    index = critical_index(leaf, connectivity)
    voxels = index.nonzero()
    values = leaf.detach()[index != 0] - level
    order = values.abs().argsort(stable=True)
    voxels = voxels[order]
    x, y, z = voxels.unbind(1)
    kinds = _kinds(_upper_codes(leaf.detach().cpu().numpy(), voxels.cpu().numpy(), connectivity), connectivity)
    return CriticalPoints(voxels, values[order], index[x, y, z].long(), kinds, -slope[x, y, z])


def _upper_codes(field: np.ndarray, voxels: np.ndarray, connectivity: int) -> Codes:
    """Neighborhoods in the solid just above each voxel's value, as codes of 27 bits; ties as in `critical_index`."""
    padded = np.pad(field, 1, constant_values=-np.inf)
    own = padded[tuple((voxels + 1).T)]
    codes = np.zeros(len(voxels), dtype=np.int32)
    for bit, offset in enumerate(OFFSETS):
        value = padded[tuple((voxels + 1 + offset).T)]
        wins_tie = bit > 13 if connectivity == 6 else bit < 13
        is_higher = (value > own) | ((value == own) & wins_tie)
        codes |= is_higher.astype(np.int32) << np.int32(bit)
    return codes


def _kinds(codes: Codes, connectivity: int) -> tuple[str, ...]:
    solid, background = count_touching(codes, connectivity)
    cases = [solid == 0, background == 0, (solid > 1) & (background > 1), solid > 1]
    return tuple(np.select(cases, [APPEARS, FILLS, SEVERAL, JOINS], CLOSES).tolist())
