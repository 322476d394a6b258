"""Matched features of volumes of tens of voxels a side, by persistent homology: a second way to the definition.

The rank of an inclusion A ⊂ U is the number of bars that are born with A and outlive U, in the filtration A ⊂ U. For
both inclusions together A and B have to be apart: A × [0, 1] and B × [2, 3] are glued to U × [1, 2]. That complex of
dimension four shrinks to U, and its part A ⊔ B comes first.
"""

from __future__ import annotations

import cripser
import numpy as np

_WITH_SOLID, _WITH_UNION, _LATER = 0.0, 1.0, 2.0


def matched_by_persistence(first, second, connectivity: int) -> list[tuple[int, int, int]]:
    """As `chain_complexes.matched_by_definition`: Betti numbers of both solids, and dim(im ∩ im), for k = 0, 1, 2."""
    union = np.where(first | second, _WITH_UNION, _LATER)
    alone = [np.where(solid, _WITH_SOLID, union) for solid in (first, second)]
    ends = [np.where(solid, _WITH_SOLID, _LATER) for solid in (first, second)]
    (betti_a, rank_a), (betti_b, rank_b) = (_counted(values, connectivity) for values in alone)
    _, together = _counted(np.stack((ends[0], union, ends[1])), connectivity)
    matched = rank_a + rank_b - together
    return list(zip(betti_a.tolist(), betti_b.tolist(), matched.tolist(), strict=True))


def _counted(values, connectivity: int):
    """Bars (3,) by dimension that are born first, and those of them that the union does not end."""
    padded = np.pad(values, 1, constant_values=_LATER)
    pairs = cripser.compute_ph(padded, filtration="V" if connectivity == 6 else "T", maxdim=2)
    first = pairs[pairs[:, 1] == _WITH_SOLID]
    lasting = first[first[:, 2] > _WITH_UNION]
    return (np.bincount(bars[:, 0].astype(int), minlength=3) for bars in (first, lasting))
