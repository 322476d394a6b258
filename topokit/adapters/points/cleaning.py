"""Rows of a cloud that are of no use: not finite, too far off, without a direction, or repeated."""

from __future__ import annotations

import torch
from torch import Tensor

from topokit.adapters.points.large import FEW
from topokit.core.cloud.sampling.copies import places
from topokit.core.samples import SurfaceSamples, largest_coordinate
from topokit.errors import InputError


def require_places(points: Tensor) -> None:
    """Refuse points (N, 3) that are all in one place."""
    if bool((points == points[0]).all()):
        raise InputError(f"all {len(points)} points are at {tuple(points[0].tolist())}: they sample no surface.")


def valid_rows(points: Tensor, normals: Tensor | None, notes: list[str]) -> tuple[Tensor, Tensor | None]:
    """Rows with finite points and, where normals are kept, valid normals; what is dropped is noted."""
    finite, what_else = _usable(points.detach())
    n_dropped = int((~finite).sum())
    if n_dropped:
        what = f"{n_dropped} of {len(points)} points are {what_else}"
        if 2 * n_dropped > len(points):
            raise InputError(
                f"{what}. More than half of the cloud is invalid: keep the finite rows yourself to use them."
            )
        notes.append(f"{what} and were dropped.")
        points = points[finite]
        normals = None if normals is None else normals[finite]
    if normals is None:
        return points, None
    valid = torch.isfinite(normals.detach()).all(-1) & (normals.detach() != 0).any(-1)
    n_invalid = int((~valid).sum())
    if n_invalid == 0:
        return points, normals
    what = f"{n_invalid} of {len(points)} normals are zero or not finite"
    if n_invalid > FEW * len(points):
        notes.append(f"{what}; all normals were ignored.")
        return points, None
    notes.append(f"{what}; their points were dropped.")
    return points[valid], normals[valid]


def one_per_place(samples: SurfaceSamples, n_neighbors: int, notes: list[str]) -> SurfaceSamples:
    """The mean of the points at each place, and of their normals up to sign; what is merged is noted.

    A cloud with too few places for its neighbors stays as it is: it is no surface, and its report says why.
    """
    points, normals = samples.points, samples.normals
    directions = None if normals is None else normals.detach().double().numpy()
    kept, owner = (torch.from_numpy(index) for index in places(points.detach().double().numpy(), directions))
    if len(kept) == len(points) or len(kept) <= n_neighbors:
        return samples
    notes.append(f"{len(points) - len(kept)} of {len(points)} points repeat others and were merged with them.")
    merged = _means(points, kept, owner)
    if normals is None:
        return SurfaceSamples(merged)
    is_opposite = (normals.detach() * normals.detach()[kept][owner]).sum(-1, keepdim=True) < 0
    return SurfaceSamples(merged, _means(torch.where(is_opposite, -normals, normals), kept, owner))


def _means(values: Tensor, kept: Tensor, owner: Tensor) -> Tensor:
    """Mean of the rows (N, 3) of each owner; equal rows have exactly their value."""
    base = values.detach()[kept]
    weight = (1 / torch.bincount(owner).to(values))[owner, None]
    return base.index_add(0, owner, weight * (values - base[owner]))


def _usable(points: Tensor) -> tuple[Tensor, str]:
    """Which rows are finite, and so near that squares are finite, too; and what the others are."""
    finite = points.isfinite().all(-1)
    if not points.is_floating_point():
        return finite, "NaN or infinite"
    near = (points.abs() <= largest_coordinate(points.dtype)).all(-1)
    n_far = int((finite & ~near).sum())
    if n_far == 0 or 2 * n_far > len(points):  # a whole cloud in such units is refused as one
        return finite, "NaN or infinite"
    return near, f"NaN, infinite or so far off that their squares leave {points.dtype}"
