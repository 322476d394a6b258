"""Known surfaces as arrays of points (n, 3) and outward unit normals (n, 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.testing import sphere_samples, torus_samples

Floats = NDArray[np.float64]
Cloud = tuple[Floats, Floats]


def sphere(n_points: int = 3000) -> Cloud:
    """χ = 2."""
    known = sphere_samples(n_points)
    return known.points.numpy(), known.normals.numpy()


def torus(n_points: int = 3000) -> Cloud:
    """χ = 0."""
    known = torus_samples(n_points)
    return known.points.numpy(), known.normals.numpy()
