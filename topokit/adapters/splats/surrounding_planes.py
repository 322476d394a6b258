"""Planes that a scene's object stands on or before: tables, floors and walls, which end where nothing joins them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from topokit.adapters.splats.disc_sizes import disc_weights
from topokit.adapters.splats.normals import normals_of
from topokit.core.arrays import Booleans, Floats

if TYPE_CHECKING:
    from topokit.adapters.splats.gaussians import GaussianSplats


_DRAWS = 200  # discs whose planes are tried
_TRIES = 8  # planes that are looked at more closely
_SAMPLED = 20_000  # splats among which planes are looked for
_THICK = 3.0  # median sizes of discs within which a splat may lie on a plane
_SIGMAS = 3.0  # standard deviations of the heights on a plane that are cut off, estimated from their median
_THINNEST = 0.1  # median sizes of discs that are cut off, at least
_COSINE = 0.7  # between the normals of a plane and of its discs, at least
_FEWEST = 100  # splats on a plane, of which borders can be seen
_SMALLEST = 0.05  # share of the scene's area on a plane, at least
_ONE_SIDE = 0.8  # share of the other area that lies on one side of it, at least
_JOINED = 0.35  # share of its border at which surface rises from it, at most; beyond, it is a face of the object
_CONTACT = 4.0  # thicknesses of a plane above it within which surface rises from it
_FULL = 0.25  # share of the median weight of a plane's cells from which a cell is occupied
_CELLS = 48  # cells along the longer side of a plane


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane of the surroundings.

    Attributes:
        normal: (3,), unit, towards the object.
        offset: of the plane along its normal, in units of length.
        thickness: distance from it up to which splats belong to it.
        share: of the scene's area on it.
    """

    normal: Floats
    offset: float
    thickness: float
    share: float

    def beyond(self, places: Floats) -> Booleans:
        """Which places (N, 3) lie on the plane or on its other side."""
        return np.asarray(places @ self.normal - self.offset < self.thickness)


def surrounding_planes(splats: GaussianSplats) -> tuple[Plane, ...]:
    """The planes of the surroundings, largest first.

    Planes through discs are tried by the area that lies on them. A plane is no face of the object if nearly all other
    area lies on one side of it and its border is mostly free: surface goes on behind the border of a face. Each plane
    is taken away with all that lies behind it before the next one is looked for.

    Args:
        splats: N splats with finite rows.
    """
    means = splats.means.detach().double().cpu().numpy()
    scales = splats.scales.detach().double().cpu()
    normals = normals_of(scales, splats.quaternions.detach().double().cpu()).numpy()
    weights = disc_weights(splats).cpu().numpy()
    thickness = _THICK * float(scales.amax(-1).median())
    rows = np.flatnonzero(weights)
    rows = rows[:: max(len(rows) // _SAMPLED, 1)]
    means, normals, weights = means[rows], normals[rows], weights[rows] / weights[rows].sum()
    found: list[Plane] = []
    is_left, is_tried = np.ones(len(means), dtype=bool), np.zeros(len(means), dtype=bool)
    for attempt in range(_TRIES):
        places = np.flatnonzero(is_left & ~is_tried)
        if weights[places].sum() < _SMALLEST:
            break
        normal, offset = _largest_plane(means[places], normals[places], weights[places], thickness, attempt)
        height = means @ normal - offset
        on = is_left & (np.abs(height) < thickness) & (np.abs(normals @ normal) > _COSINE)
        share, other = float(weights[on].sum()), weights * (is_left & (np.abs(height) >= thickness))
        if share < _SMALLEST:
            break
        above = float(other[height > 0].sum())
        sign = 1.0 if 2 * above >= other.sum() else -1.0
        middle = float(np.median(height[on]))
        spread = _SIGMAS * 1.4826 * float(np.median(np.abs(height[on] - middle)))
        cut = float(np.clip(spread, _THINNEST / _THICK * thickness, thickness))
        plane = Plane(sign * normal, sign * (offset + middle), cut, share)
        is_tried |= on
        if on.sum() < _FEWEST:
            continue
        if max(above, other.sum() - above) < _ONE_SIDE * other.sum():
            continue
        if _joined_border(plane, thickness, means[is_left], weights[is_left], on[is_left]) <= _JOINED:
            found.append(plane)
            is_left &= ~plane.beyond(means)
            is_tried[:] = False  # less is on the other side of what was tried before
    return tuple(found)


def _largest_plane(
    means: Floats, normals: Floats, weights: Floats, thickness: float, seed: int
) -> tuple[Floats, float]:
    """Unit normal and offset of the plane of a disc on which most area lies, fitted to the discs there."""
    rng = np.random.default_rng(seed)
    best, most = (normals[0], float(means[0] @ normals[0])), -1.0
    for number in rng.choice(len(means), size=_DRAWS, p=weights / weights.sum()):
        normal = normals[number]
        offset = float(means[number] @ normal)
        on = (np.abs(means @ normal - offset) < thickness) & (np.abs(normals @ normal) > _COSINE)
        if (area := float(weights[on].sum())) > most:
            best, most = (normal, offset), area
    for _ in range(3):
        normal, offset = best
        on = (np.abs(means @ normal - offset) < thickness) & (np.abs(normals @ normal) > _COSINE)
        if on.sum() < 3:
            break
        middle = np.average(means[on], axis=0, weights=weights[on])
        offsets = means[on] - middle
        axis = np.linalg.eigh((offsets * weights[on, None]).T @ offsets)[1][:, 0]
        best = axis, float(middle @ axis)
    return best


def _joined_border(plane: Plane, thickness: float, means: Floats, weights: Floats, on: Booleans) -> float:
    """The share of the border of a plane's region at which surface rises from it."""
    sides = np.linalg.svd(plane.normal[None])[2][1:]
    place = means @ sides.T
    low, high = place[on].min(0), place[on].max(0)
    cell = float((high - low).max()) / _CELLS
    if cell == 0:
        return 1.0  # all in one place
    height = means @ plane.normal - plane.offset
    rising = (height >= thickness) & (height < (1 + _CONTACT) * thickness)
    shape = tuple(np.ceil((high - low) / cell).astype(int) + 7)
    index = np.floor((place - low) / cell).astype(int) + 3
    is_near = ((index >= 0) & (index < shape)).all(1)

    def area(chosen: Booleans) -> Floats:
        held = index[chosen & is_near]
        flat = np.ravel_multi_index((held[:, 0], held[:, 1]), shape)
        return np.bincount(flat, weights[chosen & is_near], minlength=shape[0] * shape[1]).reshape(shape)

    own = area(on)
    full = _FULL * float(np.median(own[own > 0]))
    region = ndimage.binary_fill_holes(ndimage.binary_closing(own > full, iterations=2))
    border = region & ~ndimage.binary_erosion(region, iterations=2)
    joined = ndimage.binary_dilation(area(rising) > full, iterations=2)
    return float(joined[border].mean()) if border.any() else 1.0
