"""Noisy images of vessel trees and of membranes with exactly known masks, in the plane and in space, made here.

A mask grows piece by piece. A piece stays only if the mask has the Betti numbers that are meant, and still has them one
voxel thicker, so that what is apart is apart by more than a voxel. The image of a mask has what makes a network break
it: stretches without contrast, specks and blobs that look like it, a bias and noise.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter, generate_binary_structure

from topokit.core.grid.betti import betti_numbers

Mask = NDArray[np.bool_]
Betti = tuple[int, int, int]
Floats = NDArray[np.float64]
Grow = Callable[[Mask, np.random.Generator], tuple[Mask, Betti]]

GAP_DEPTH = (0.75, 1.0)  # share of the contrast that a gap takes
GAP_RADIUS = (1.5, 2.6)  # standard deviation of a gap, in voxels
VOXELS_PER_GAP = {2: 70, 3: 350}  # of the mask
VOXELS_PER_BLOB = {2: 1100, 3: 6000}  # of the image
BIAS, NOISE, SPECKLE = 0.25, 0.25, 0.35  # standard deviations; the contrast is 1


class NoisyMask(NamedTuple):
    """An image, its true mask and the mask's components, tunnels (in the plane: holes) and cavities."""

    image: NDArray[np.float32]
    mask: Mask
    betti: Betti


def noisy_mask(family: str, dims: int, size: int, seed: int) -> NoisyMask:
    """An image (size, size) or (size, size, size) of a family; the same for the same seed."""
    rng = np.random.default_rng((seed, dims, size, *family.encode()))
    mask, betti = FAMILIES[family](np.zeros((size,) * dims, dtype=bool), rng)
    return NoisyMask(_image(mask, rng), mask, betti)


def counted(mask: Mask) -> Betti:
    """Components, tunnels and cavities, 26- or 8-connected; in the plane tunnels are holes."""
    parts, tunnels, cavities = betti_numbers(torch.from_numpy(_in_space(mask))).tolist()
    return parts, tunnels, cavities


def _trees(mask: Mask, rng: np.random.Generator) -> tuple[Mask, Betti]:
    """One to three trees of round branches."""
    n_trees, wanted = 0, int(rng.integers(1, 4))
    centers: list[Floats] = []
    for _ in range(40):
        starts = n_trees < wanted and (not centers or rng.random() < 0.3)
        start = rng.uniform(0.1, 0.9, mask.ndim) * mask.shape if starts else centers[rng.integers(len(centers))]
        path = _path(start, rng, mask.shape)
        grown = mask | _tube(path, rng.uniform(1.2, 2.0), mask.shape)
        if _is_clear(grown, (n_trees + starts, 0, 0)) and grown.sum() > mask.sum() + 8:
            mask, n_trees = grown, n_trees + starts
            centers.extend(path)
    return mask, (n_trees, 0, 0)


def _path(start: Floats, rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
    """Points of a smooth walk one voxel apart, until it leaves the image or is half as long as that."""
    heading = rng.normal(size=len(shape))
    points = [start]
    for _ in range(rng.integers(shape[0] // 5, shape[0] * 2 // 3)):
        heading = heading / np.linalg.norm(heading) + rng.normal(0, 0.2, len(shape))
        points.append(points[-1] + heading / np.linalg.norm(heading))
        if not all(1 <= x <= n - 2 for x, n in zip(points[-1], shape, strict=True)):
            break
    return np.array(points)


def _tube(path: Floats, radius: float, shape: tuple[int, ...]) -> Mask:
    """What is within a radius of the points."""
    away = np.ones(shape, dtype=bool)
    away[tuple(np.clip(np.round(path).astype(int), 0, shape[0] - 1).T)] = False
    return distance_transform_edt(away) <= radius


def _sheets(mask: Mask, rng: np.random.Generator) -> tuple[Mask, Betti]:
    """One curved membrane across the image, and closed ones beside it: in the plane, curves."""
    n_closed, mask = 0, _sheet(mask.shape, rng)
    while not _is_clear(mask, _closed(0, mask.ndim)):
        mask = _sheet(mask.shape, rng)
    for _ in range(20):
        grown = mask | _bubble(mask.shape, rng)
        if _is_clear(grown, _closed(n_closed + 1, mask.ndim)):
            mask, n_closed = grown, n_closed + 1
    return mask, _closed(n_closed, mask.ndim)


def _closed(number: int, dims: int) -> Betti:
    """Betti numbers of a membrane with so many closed ones beside it."""
    return (1 + number, 0, number) if dims == 3 else (1 + number, number, 0)


def _sheet(shape: tuple[int, ...], rng: np.random.Generator) -> Mask:
    """A membrane across the image, of even thickness."""
    size, axis = shape[0], int(rng.integers(len(shape)))
    wave = gaussian_filter(rng.normal(size=shape[1:]), size / 6, mode="wrap")
    height = size * (rng.choice((-1, 1)) * rng.uniform(0.1, 0.25) + 0.5 + 0.07 * (wave - wave.mean()) / wave.std())
    slopes = np.gradient(height) if height.ndim > 1 else [np.gradient(height)]
    half = rng.uniform(0.9, 1.3) * np.sqrt(1 + sum(np.square(slope) for slope in slopes))  # more where it is steep
    along = np.arange(size).reshape(-1, *[1] * height.ndim)
    return np.moveaxis(np.abs(along - height) <= half, 0, axis)


def _bubble(shape: tuple[int, ...], rng: np.random.Generator) -> Mask:
    """A closed membrane around an ellipsoid."""
    size = shape[0]
    radii = rng.uniform(max(4.0, 0.11 * size), 0.22 * size, len(shape))
    center = [rng.uniform(r + 2, size - r - 3) for r in radii]
    from_center = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1) - center
    inside = np.linalg.norm(from_center / radii, axis=-1) < 1
    distance = np.where(inside, distance_transform_edt(inside), 1 - distance_transform_edt(~inside))
    return np.abs(distance) <= rng.uniform(1.0, 1.5)


FAMILIES: dict[str, Grow] = {"trees": _trees, "sheets": _sheets}


def _is_clear(mask: Mask, betti: Betti) -> bool:
    """Whether the mask has these Betti numbers, and keeps them when it becomes one voxel thicker."""
    thick = binary_dilation(mask, generate_binary_structure(mask.ndim, mask.ndim))
    return counted(mask) == counted(thick) == betti


def _in_space(mask: Mask) -> Mask:
    return mask.reshape(*mask.shape, *[1] * (3 - mask.ndim))


def _image(mask: Mask, rng: np.random.Generator) -> NDArray[np.float32]:
    """What a microscope or scanner might show of the mask; of mean 0 and standard deviation 1."""
    dims, shape = mask.ndim, mask.shape
    places = np.argwhere(mask)
    contrast = np.ones(shape)
    for place in places[rng.integers(len(places), size=max(1, len(places) // VOXELS_PER_GAP[dims]))]:
        contrast *= 1 - rng.uniform(*GAP_DEPTH) * _bump(place, rng.uniform(*GAP_RADIUS), shape)
    signal = gaussian_filter(mask * contrast, 0.6)
    for _ in range(mask.size // VOXELS_PER_BLOB[dims]):
        place = rng.uniform(0, 1, dims) * shape
        signal = np.maximum(signal, rng.uniform(0.5, 1.0) * _bump(place, rng.uniform(0.8, 1.6), shape))
    bias = gaussian_filter(rng.normal(size=shape), shape[0] / 5, mode="nearest")
    image = signal * (1 + SPECKLE * rng.normal(size=shape)) + BIAS * bias / bias.std() + NOISE * rng.normal(size=shape)
    return ((image - image.mean()) / image.std()).astype(np.float32)


def _bump(place: Floats, width: float, shape: tuple[int, ...]) -> Floats:
    """A Gaussian of height 1."""
    square = np.zeros(shape)
    for axis, x in zip(np.ogrid[tuple(map(slice, shape))], place, strict=True):
        square = square + np.square(axis - x)
    return np.exp(-square / (2 * width**2))
