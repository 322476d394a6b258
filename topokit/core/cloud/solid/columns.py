"""Vectors as columns (3, n), of which NumPy computes products several times faster than of rows, and circumcenters."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Floats, Integers

Triple = tuple[Floats, Floats, Floats]


def dot_columns(first: Floats, second: Floats) -> Floats:
    """Scalar products (n,) of columns (3, n)."""
    return np.asarray(np.einsum("an,an->n", first, second))


def cross_columns(first: Floats, second: Floats) -> Floats:
    """Cross products of columns (3, n)."""
    (x, y, z), (u, v, w) = first, second
    return np.stack((y * w - z * v, z * u - x * w, x * v - y * u))


def edges_of(columns: Floats, tetrahedra: Integers) -> Triple:
    """The edges (3, T) from the first corner of tetrahedra (T, 4) of points (3, N) to the others."""
    start = columns.take(tetrahedra[:, 0], axis=1)
    a, b, c = (columns.take(tetrahedra[:, k], axis=1) - start for k in (1, 2, 3))
    return a, b, c


def facing_crosses(edges: Triple) -> Triple:
    """b × c, c × a and a × b of the edges a, b, c: normals of the facets at the first corner."""
    a, b, c = edges
    return cross_columns(b, c), cross_columns(c, a), cross_columns(a, b)


def circumcenters(edges: Triple, crosses: Triple) -> tuple[Floats, Floats]:
    """The circumcenters relative to the first corners by Cramer's rule: numerators (3, T) over determinants (T,)."""
    a, b, c = (dot_columns(edge, edge) for edge in edges)
    bc, ca, ab = crosses
    return a * bc + b * ca + c * ab, 2 * dot_columns(edges[0], bc)
