"""Downsampling: fewer samples, placed where a surface needs them.

Which points of a large cloud a report uses is decided in `samples_of_large_clouds`, and of one larger than memory in
`larger_than_memory`.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import torch

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.normals.patches import patches_of
from topokit.core.cloud.sampling.copies import distinct
from topokit.core.cloud.sampling.cube_hierarchy import CubeHierarchy, curve_order
from topokit.core.cloud.settings import PatchSettings
from topokit.core.labels import count_distinct
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError

Criterion = Literal["feature-size", "curvature", "even"]

_FEWEST_FOR_AXES = 32  # distinct points from which axes and noise are measured
_ATTEMPTS = 16  # sides of cubes that are tried for even downsampling
_ENOUGH = 0.9  # share of the wanted number of cubes that is near enough
_TIE = 1e-6  # squared distances that differ by no larger share are equal: rounding must not decide between them
_WAVES = np.array([4127.3, 6211.7, 5309.1])  # radians across the box along each axis; many even in a small cube


def fewer_samples(samples: SurfaceSamples, n_samples: int, by: Criterion) -> SurfaceSamples:
    """Some of the samples, with their normals and frames; areas are summed over those that each one stands for.

    Args:
        samples: (N, 3), not batched.
        n_samples: number of samples to keep, at most.
        by: see `downsample`; signs of normals tell opposite sheets apart
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


def downsample(
    points: Floats, n_samples: int, by: Criterion, normals: Floats | None = None, noise: float = 0.0
) -> tuple[Integers, Integers]:
    """Points to keep, and for every point the kept one that stands for it.

    Space is divided into cubes, and in each the point nearest to the centroid is kept. Deterministic, O(N log N).

    Args:
        points: (N, 3), finite.
        n_samples: number of points to keep, at most.
        by: "feature-size": cubes are split while the points within are not flat, because the surface bends or because
            an opposite sheet is near; with normals, opposite sheets are kept both and cost no more than a plane.
            "curvature": cubes are split while the normals within differ. "even": cubes of one size.
        normals: (N, 3), unit; needed for "curvature", whose signs do not matter there.
        noise: standard deviation of the points from the surface; cubes that are not thicker are flat.

    Returns:
        Indices (M,) of the kept points, M ≤ n_samples, ascending; and for each point (N,) a position 0 … M−1 in them.
    """
    if n_samples >= len(points) or not np.ptp(points, axis=0).max() > 0:
        return np.arange(len(points)), np.arange(len(points))
    if by == "even":
        return representatives(points, even_cells(points, n_samples))
    hierarchy = CubeHierarchy(points, normals, largest=n_samples, noise=noise, thickness=by == "feature-size")
    return representatives(points, hierarchy.cells(n_samples))


def representatives(points: Floats, cells: Integers) -> tuple[Integers, Integers]:
    """The point of each cell nearest to its centroid, ascending, and every point's position in that list.

    The two points of a cell of two are equally far from their centroid. Of points that tie, the one is kept whose
    place gives the smallest pseudo-random number, so that neither rounding nor the order of the points decides.

    Args:
        points: (N, 3).
        cells: (N,), cell of each point; every cell 0 … c−1 holds one.
    """
    count = np.bincount(cells)
    centroid = np.stack([np.bincount(cells, column) for column in points.T], axis=1) / count[:, None]
    distance = ((points - centroid[cells]) ** 2).sum(1)
    nearest = np.full(len(count), np.inf)
    np.minimum.at(nearest, cells, distance)
    is_farther = distance > (1 + _TIE) * nearest[cells]
    order = np.lexsort((_mixed(points), is_farther, cells))
    kept = order[np.cumsum(count) - count]
    rank = np.empty_like(kept)
    rank[np.argsort(kept)] = np.arange(len(kept))
    return np.sort(kept), rank[cells]


def _mixed(points: Floats) -> Floats:
    """A number from −1 to 1 for each point (N, 3), continuous in its place, that looks random from cube to cube."""
    low = points.min(0)
    extent = float((points.max(0) - low).max()) or 1.0  # all in one place
    return np.asarray(np.sin((points - low) / extent @ _WAVES))


def even_cells(points: Floats, n_cells: int) -> Integers:
    """The cube, among cubes of one size, in which each point (N, 3) lies; at most about `n_cells` hold points."""
    low = points.min(0)
    smallest, largest = 0.0, float((points.max(0) - low).max())
    side = largest / max(n_cells, 1) ** 0.5
    for _ in range(_ATTEMPTS):  # a surface meets about side⁻² cubes
        cube = _cubes(points - low, side)
        found = count_distinct(cube)
        if _ENOUGH * n_cells <= found <= n_cells:
            break
        smallest, largest = (side, largest) if found > n_cells else (smallest, side)
        guess = side * (found / (n_cells * (1 + _ENOUGH) / 2)) ** 0.5
        side = guess if smallest < guess < largest else (smallest + largest) / 2
    return np.unique(cube, return_inverse=True)[1].ravel()


def thin_along_curve(points: Floats, most: int) -> Integers:
    """Indices, ascending, of every n-th point along a Z-order curve, at most `most`: density keeps its proportions."""
    if len(points) <= most:
        return np.arange(len(points))
    step = -(-len(points) // most)
    return np.sort(curve_order(points)[0][step // 2 :: step])


def _cubes(offsets: Floats, side: float) -> Integers:
    """Index of the cube that each point (N, 3) lies in."""
    cell = (offsets / side).astype(np.int64)
    n_x, n_y, _ = cell.max(0) + 1
    return np.asarray((cell[:, 2] * n_y + cell[:, 1]) * n_x + cell[:, 0])
