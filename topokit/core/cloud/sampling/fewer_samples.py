"""Fewer samples of a surface, with their attributes."""

from __future__ import annotations

from typing import get_args

import numpy as np
import torch

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.normals.patches import patches_of
from topokit.core.cloud.sampling.copies import distinct
from topokit.core.cloud.sampling.downsampling import Criterion, downsample
from topokit.core.cloud.settings import PatchSettings
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError

_FEWEST_FOR_AXES = 32  # distinct points from which axes and noise are measured


def fewer_samples(samples: SurfaceSamples, n_samples: int, by: Criterion) -> SurfaceSamples:
    """Some of the samples, with their normals and frames; areas are summed over those that each one stands for.

    Args:
        samples: (N, 3), not batched.
        n_samples: number of samples to keep, at most.
        by: see `downsample` in `topokit.core.cloud.sampling.downsampling`; signs of normals tell opposite sheets apart
            only if they are known. Points at fewer than 32 places are chosen evenly.

    Returns:
        `SurfaceSamples`, differentiable in the samples at a fixed choice.

    Raises:
        InputError: for batches, an unknown criterion or a number below four.
    """
    if by not in get_args(Criterion):
        raise InputError(f"by is {by!r}; expected one of {', '.join(map(repr, get_args(Criterion)))}.")
    if samples.points.ndim != 2:
        raise InputError(f"one cloud can be downsampled, but the samples are batched, {tuple(samples.points.shape)}.")
    if n_samples < 4:
        raise InputError(f"{n_samples} samples cannot stand for a surface: keep at least 4.")
    points = np.ascontiguousarray(samples.points.detach().cpu().double().numpy())
    first, place = distinct(points)
    if by == "even" or len(first) < _FEWEST_FOR_AXES:
        kept, owner = downsample(points, n_samples, "even")
    else:
        kept, owner = downsample(points, n_samples, by, *_directions(points[first], place, samples, by))
    chosen = samples.at(torch.from_numpy(kept).to(samples.points.device))
    if samples.areas is None:
        return chosen
    areas = torch.zeros_like(samples.areas[: len(kept)])
    areas = areas.index_add(0, torch.from_numpy(owner).to(areas.device), samples.areas)
    return SurfaceSamples(chosen.points, chosen.normals, chosen.frames, areas, chosen.oriented)


def _directions(places: Floats, owner: Integers, samples: SurfaceSamples, by: Criterion) -> tuple[Floats | None, float]:
    """Unit normals (N, 3) for the criterion, or None, and the noise; from places (M, 3) and the place (N,) of each."""
    surface = patches_of(places, PatchSettings())
    known = samples.known_normals()
    if known is not None and (samples.oriented or by == "curvature"):
        directions = torch.nn.functional.normalize(known.detach().double(), dim=-1).cpu().numpy()
        return directions, surface.thickness
    return (surface.planes.axes[owner] if by == "curvature" else None), surface.thickness
