"""How far two solids agree apart from topology: the numbers that are usually reported beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from topokit.core.arrays import Booleans, Floats
from topokit.core.grid.grid import Spacing


@dataclass(frozen=True)
class Agreement:
    """Overlap of two solids and distance of their surfaces; None where a solid is empty and a number has no meaning.

    Attributes:
        dice: 2 |a ∩ b| / (|a| + |b|); 1 if both are empty.
        cl_dice: clDice, the same for centerlines: harmonic mean of the shares of each skeleton in the other solid. None
            also if a skeleton is empty, as that of some cubes.
        surface_dice: share of the voxels of both surfaces that are within the tolerance of the other surface.
        hausdorff_95: 95th percentile of the distances between the surfaces, the larger of both directions.
        voi: variation of information between the parts of a and those of b, in bits: over-splitting, over-merging.
        tolerance: of `surface_dice`, in units of length.
    """

    dice: float
    cl_dice: float | None
    surface_dice: float | None
    hausdorff_95: float | None
    voi: tuple[float, float] | None
    tolerance: float


def agreement(
    first: Booleans, second: Booleans, parts: tuple[object, object], spacing: Spacing, tolerance: float
) -> Agreement:
    """How far two solids (X, Y, Z) agree.

    Args:
        first: whether a voxel is in the solid that is judged.
        second: whether it is in the true one.
        parts: labels (X, Y, Z) of the parts of both.
        spacing: of the grid.
        tolerance: distance of surfaces that counts as none.

    References:
        S. Shit et al., "clDice: a novel topology-preserving loss function for tubular structure segmentation", CVPR
        2021, arXiv:2003.07311. S. Nikolov et al., arXiv:1809.04430 (surface Dice; here by voxels, not by area).
        M. Meilă, "Comparing clusterings: an information based distance", 2007, doi:10.1016/j.jmva.2006.11.013.
    """
    from skimage.metrics import variation_of_information
    from skimage.morphology import skeletonize

    if not (first.any() and second.any()):
        return Agreement(dice(first, second), None, None, None, None, tolerance)
    pairs = ((first, second), (second, first))
    centered = [other[skeletonize(np.pad(own, 1))[1:-1, 1:-1, 1:-1] > 0] for own, other in pairs]
    shares = [float(inside.mean()) if len(inside) else 0.0 for inside in centered]
    distances = _surface_distances(first, second, spacing)
    split, merge = variation_of_information(parts[1], parts[0])
    return Agreement(
        dice(first, second),
        (2 * shares[0] * shares[1] / sum(shares) if sum(shares) else 0.0) if all(map(len, centered)) else None,
        float((np.concatenate(distances) <= tolerance).mean()),
        max(float(np.percentile(one, 95)) for one in distances),
        (float(split), float(merge)),
        tolerance,
    )


def dice(first: Booleans, second: Booleans) -> float:
    """2 |a ∩ b| / (|a| + |b|) of two solids; 1 if both are empty."""
    size = int(first.sum()) + int(second.sum())
    return 2 * int((first & second).sum()) / size if size else 1.0


def _surface_distances(first: Booleans, second: Booleans, spacing: Spacing) -> tuple[Floats, Floats]:
    """Distances of the surface voxels of each solid from those of the other one."""
    one, other = (solid & ~ndimage.binary_erosion(solid) for solid in (first, second))
    there = ndimage.distance_transform_edt(~other, spacing)[one]
    return there, ndimage.distance_transform_edt(~one, spacing)[other]
