"""Moving one solid on a grid towards another without changing its topology.

Voxels in which the two differ change sides, layer after layer, as long as each is simple at its turn. What is left when
none is simple any more is where the two solids differ in topology and not only in place: membranes, gaps, bridges and
channels one voxel thick, and the whole of parts and cavities that only one of them has.

Reference:
    X. Hu, "Structure-aware image segmentation with homotopy warping", NeurIPS 2022, arXiv:2112.07812 (the idea; here in
    3D, whole batches of voxels at a time).
"""

from __future__ import annotations

import numpy as np

from topokit.core.homotopy.simple_points import Bools, PaddedSolid, is_simple


def deform(solid: Bools, towards: Bools, connectivity: int | None = None) -> Bools:
    """The solid, moved towards another one as far as its topology allows.

    Voxels of the same parity are not neighbours, so changing all the simple ones among them at once is the same as one
    after the other. Deterministic.

    Args:
        solid: (X, Y, Z), whose topology is kept.
        towards: (X, Y, Z).
        connectivity: 6 or 26, that of the solid; None keeps the topology in both.

    Returns:
        (X, Y, Z).

    Raises:
        InputError: for another connectivity.
    """
    padded = PaddedSolid(solid)
    waiting = padded.indices(solid != towards)
    parity = padded.parity(waiting)
    while True:
        changed = np.zeros(len(waiting), dtype=bool)
        on_surface = padded.on_surface(waiting, through_faces=connectivity is None)
        for mutually_distant in range(8):
            at = np.flatnonzero(on_surface & (parity == mutually_distant))
            at = at[is_simple(padded.codes(waiting[at]), connectivity)]
            padded.inside[waiting[at]] ^= 1
            changed[at] = True
        if not changed.any():
            return padded.solid()
        waiting, parity = waiting[~changed], parity[~changed]
