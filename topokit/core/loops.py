"""Closed curves on a surface, as exports and reports show them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Floats, Integers
from topokit.core.components import Corner


@dataclass(frozen=True, eq=False)
class BoundaryLoop:
    """One curve along which a surface ends.

    Attributes:
        points: (N, 3), in order; the last is joined to the first if the curve is closed.
        index: (N,), which vertices of the mesh, or samples of the cloud, these are.
        length: its length, in units of length.
        bounds: lowest and highest corner of its bounding box.
        closed: False for a curve that ends at non-manifold edges.
    """

    points: Floats
    index: Integers
    length: float
    bounds: tuple[Corner, Corner]
    closed: bool = True

    @classmethod
    def through(cls, points: Floats, index: Integers, closed: bool = True) -> BoundaryLoop:
        """The curve through some of the points (N, 3), by their index (M,) in order."""
        own = points[index]
        steps = np.linalg.norm(np.diff(own, axis=0, append=own[:1]), axis=1)
        return cls(own, index, float(steps.sum() if closed else steps[:-1].sum()), bounds_of(own), closed)


def bounds_of(points: Floats) -> tuple[Corner, Corner]:
    """Lowest and highest corner of the bounding box of points (N, 3)."""
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def width_of(bounds: tuple[Corner, Corner]) -> float:
    """The longest side of a box."""
    return max(b - a for a, b in zip(*bounds, strict=True))


def middle(bounds: tuple[Corner, Corner]) -> Corner:
    """Middle of a box."""
    x, y, z = ((a + b) / 2 for a, b in zip(*bounds, strict=True))
    return x, y, z
