"""Homotopy warping: deforms one solid on a grid toward another without changing its topology.

Voxels in which the two differ are flipped, layer after layer, as long as each is simple when its turn comes. The
difference that remains is one of topology: membranes, gaps, bridges and channels one voxel thick, and the whole of
parts and cavities that only one of the solids has.

Reference:
    X. Hu, "Structure-aware image segmentation with homotopy warping", NeurIPS 2022, arXiv:2112.07812. Here
    in 3D, and many voxels at a time.
"""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Booleans
from topokit.core.homotopy.simple_points import PaddedSolid


def deform(solid: Booleans, target: Booleans, connectivity: int | None = None) -> Booleans:
    """Deform a solid toward another one as far as its topology allows.

    Voxels of the same parity are not neighbors, so flipping all the simple ones among them at once is the same as
    flipping them one after the other. The result is deterministic.

    Args:
        solid: (X, Y, Z), its topology is kept.
        target: (X, Y, Z).
        connectivity: 6 or 26, that of the solid; None keeps the topology in both.

    Returns:
        (X, Y, Z), homotopic to `solid`.

    Raises:
        InputError: if the connectivity is neither 6, 26 nor None.
    """
    padded = PaddedSolid(solid)
    waiting = padded.indices(solid != target)
    parity = padded.parity(waiting)
    while True:
        changed = np.zeros(len(waiting), dtype=bool)
        on_surface = padded.on_surface(waiting, through_faces=connectivity is None)
        for group in range(8):
            at = np.flatnonzero(on_surface & (parity == group))
            changed[at] = padded.flip_simple(waiting[at], connectivity)
        if not changed.any():
            return padded.solid()
        waiting, parity = waiting[~changed], parity[~changed]
