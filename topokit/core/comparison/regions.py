"""Which connected regions two sets of voxels have in common: the parts of two solids, and their cavities.

Parts: two parts match if they lie in one part of the union. So of every part of the union that holds parts of both
solids one is matched, and the others of it are surplus.

Cavities: by Alexander duality H₂ of a solid is the space of functions on the regions of its background, up to
constants, and inclusion restricts functions. A function on the regions of the common background comes from both solids
if it is constant on regions that lie in one region of either background. Regions that are linked so form classes;
that of the outside is the constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from topokit.core.arrays import Booleans, Integers
from topokit.core.grid.euler import dual_connectivity
from topokit.core.labels import connected_labels

Labels = NDArray[np.int32]
Pair = tuple[Booleans, Booleans]


@dataclass(frozen=True, eq=False)
class MatchedRegions:
    """Regions of two sets, in classes of regions that are the same.

    Attributes:
        labels: of each set, (X, Y, Z), 0 outside and numbers of regions from 1 on.
        classes: of each set, the class (n + 1,) of each label; that of 0 has no meaning.
        kept: of each set, whether a label (n + 1,) is the largest of its class, and the class has regions of both.
        n_outside: 1 if one of the classes is the outside of the solids, else 0.
    """

    labels: tuple[Labels, Labels]
    classes: tuple[Integers, Integers]
    kept: tuple[Booleans, Booleans]
    n_outside: int

    @property
    def betti(self) -> tuple[int, int]:
        """Regions of each set, without the outside."""
        one, other = (len(kept) - 1 - self.n_outside for kept in self.kept)
        return one, other

    @property
    def matched(self) -> int:
        """Classes that have regions of both sets, without the outside."""
        return int(self.kept[0].sum()) - self.n_outside

    def unmatched(self, side: int) -> Integers:
        """The labels of one set that are not kept."""
        return 1 + np.flatnonzero(~self.kept[side][1:])

    def is_shared(self, side: int, label: int) -> bool:
        """Whether the other set has regions in the class of a label."""
        return bool(np.isin(self.classes[side][label], self.classes[1 - side][1:]))


def matched_parts(solids: Pair, connectivity: int) -> MatchedRegions:
    """The parts of two solids (X, Y, Z).

    Args:
        solids: whether a voxel is in them.
        connectivity: 6 or 26, theirs.
    """
    union, _ = _labeled(solids[0] | solids[1], connectivity)
    labels, classes = [], []
    for solid in solids:
        own, n_regions = _labeled(solid, connectivity)
        of_label = np.zeros(n_regions + 1, np.int64)
        of_label[own[solid]] = union[solid]
        labels.append(own)
        classes.append(of_label)
    return _matched((labels[0], labels[1]), (classes[0], classes[1]), 0)


def matched_cavities(solids: Pair, connectivity: int) -> MatchedRegions:
    """The cavities of two solids; labels are those of their background with one layer around it, (X + 2, …).

    Arguments are those of `matched_parts`.
    """
    backgrounds = [np.pad(~solid, 1, constant_values=True) for solid in solids]
    common = backgrounds[0] & backgrounds[1]
    (one, n_one), (other, n_other) = (_labeled(each, dual_connectivity(connectivity)) for each in backgrounds)
    classes = connected_labels(
        1 + n_one + n_other, one[common].astype(np.int64), n_one + other[common].astype(np.int64)
    )
    second = np.concatenate((classes[:1], classes[1 + n_one :]))
    return _matched((one, other), (classes[: 1 + n_one], second), 1)


def smallest_links(between: Labels, labels: Labels) -> dict[int, int]:
    """For each region that is near another one the smallest region between them that links the two.

    Args:
        between: (X, Y, Z) labels of regions that may link.
        labels: (X, Y, Z) labels of the regions that they may link, likewise 0 outside.
    """
    near = _neighbors(between, labels)
    near = near[np.bincount(near[:, 0])[near[:, 0]] > 1]  # regions that are near one alone link nothing
    sizes = np.bincount(between.ravel())
    near = near[np.lexsort((near[:, 0], sizes[near[:, 0]]))]
    linked, first = np.unique(near[:, 1], return_index=True)
    return dict(zip(linked.tolist(), near[first, 0].tolist(), strict=True))


def _neighbors(first: Labels, second: Labels) -> Integers:
    """The pairs of labels (P, 2) of voxels that are the same or share at least a corner."""
    one, other = (np.pad(labels, 1) for labels in (first, second))
    where, n_second = np.flatnonzero(one), int(other.max(initial=0)) + 1
    own, others = one.ravel()[where].astype(np.int64) * n_second, other.ravel()
    strides = np.array(one.strides) // one.itemsize
    codes = []
    for step in product((-1, 0, 1), repeat=3):
        near = others[where + int(strides @ step)]
        codes.append(np.unique(own[near > 0] + near[near > 0]))
    code = np.unique(np.concatenate(codes))
    return np.stack((code // n_second, code % n_second), axis=1)


def _labeled(mask: Booleans, connectivity: int) -> tuple[Labels, int]:
    labels, n_regions = ndimage.label(mask, structure=np.ones((3, 3, 3)) if connectivity == 26 else None)
    return labels, int(n_regions)


def _matched(labels: tuple[Labels, Labels], classes: tuple[Integers, Integers], n_outside: int) -> MatchedRegions:
    kept = [np.zeros(len(of_label), bool) for of_label in classes]
    for side in (0, 1):
        sizes = np.bincount(labels[side].ravel(), minlength=len(classes[side]))
        if n_outside:
            sizes[labels[side].flat[0]] = labels[side].size  # the outside stands for its class
        order = 1 + np.lexsort((np.arange(1, len(sizes)), -sizes[1:]))
        _, first = np.unique(classes[side][order], return_index=True)
        kept[side][order[first]] = True
    for side in (0, 1):
        kept[side][1:] &= np.isin(classes[side][1:], classes[1 - side][1:])
    return MatchedRegions(labels, classes, (kept[0], kept[1]), n_outside)
