"""Points of a cloud that are at one place, all or some."""

from __future__ import annotations

import torch
from torch import Tensor

from topokit.core.cloud.sampling.copies import places
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError


def require_places(points: Tensor) -> None:
    """Refuse points (N, 3) that are all in one place."""
    if bool((points == points[0]).all()):
        raise InputError(f"all {len(points)} points are at {tuple(points[0].tolist())}: they sample no surface.")


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
