"""Persistent homology of arrays, by cripser.

Reference:
    S. Kaji, T. Sudo, K. Ahara, "Cubical Ripser", arXiv:2005.12692.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Floats
from topokit.errors import requiring


def cubical_pairs(values: NDArray[np.floating[Any]], filtration: Literal["V", "T"]) -> Floats:
    """When classes of dimension 0 to 2 appear and disappear in the sublevel sets of values on a grid, and where.

    Args:
        values: (X, Y, Z).
        filtration: "V" joins values through faces (6-connected), "T" also through corners (26-connected).

    Returns:
        (M, 9): dimension, birth, death (infinite for a class that stays), and the vertices at which it appears and
        disappears.

    Raises:
        MissingDependencyError: if cripser is not installed.
    """
    with requiring("Persistent homology needs cripser: pip install cripser."):
        import cripser
    pairs: Floats = cripser.compute_ph(values, filtration=filtration, maxdim=2)
    return pairs
