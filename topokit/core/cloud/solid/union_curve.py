"""χ and Betti numbers of the union of balls around points at all radii.

The union has the homotopy type of the alpha complex (see `alpha`). Pieces join along a minimum spanning tree of its
edges. Cavities are regions of tetrahedra that are not in the complex, apart from the one outside: as the radius falls,
these join along a minimum spanning tree of the facets between them. Tunnels are β₁ = β₀ + β₂ − χ.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import KDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.blocks.curve import EulerCurve
from topokit.core.cloud.solid.alpha import AlphaComplex, union_of_balls
from topokit.errors import InputError

_FEWEST_POINTS = 5  # of tetrahedra whose neighbors are known


def union_curve(points: Floats) -> EulerCurve:
    """χ and Betti numbers of the union of balls around points (N, 3), over the radius of the balls.

    The points are moved by a ten-thousandth of the median distance to the nearest other one, so that no five are on a
    sphere; so much are the radii wrong.

    Raises:
        InputError: if fewer than 5 points are distinct.
    """
    points = np.unique(points, axis=0)
    if len(points) < _FEWEST_POINTS:
        raise InputError(f"{len(points)} distinct points; a union of balls needs at least {_FEWEST_POINTS}.")
    nearest = KDTree(points).query(points, k=2)[0][:, 1]
    return curve_of(union_of_balls(points, float(np.median(nearest))))


def curve_of(balls: AlphaComplex) -> EulerCurve:
    """χ and Betti numbers of alpha complexes over their radius."""
    edges, sides = balls.edges, balls.facet_sides
    radii, eulers = balls.euler_curve()
    levels = np.unique(np.append(0.0, radii[np.isfinite(radii)]))
    euler = np.append(balls.n_points, eulers)[np.searchsorted(radii, levels, side="right")]
    joined = _joining(balls.n_points, edges[:, 0], edges[:, 1], balls.edge_radii)
    pieces = balls.n_points - np.searchsorted(joined, levels, side="right")
    n_tetrahedra = len(balls.tetrahedron_radii)
    apart = -_joining(n_tetrahedra + 1, sides[:, 0], sides[:, 1], -balls.facet_radii)[::-1]
    filled = np.searchsorted(np.sort(balls.tetrahedron_radii), levels, side="right")
    passed = len(apart) - np.searchsorted(apart, levels, side="right")  # facets of the tree that are still open
    cavities = n_tetrahedra - filled - passed
    betti = np.stack((pieces, pieces + cavities - euler, cavities), axis=1)
    changes = np.ones(len(levels), bool)
    changes[1:] = (betti[1:] != betti[:-1]).any(1)
    return EulerCurve(levels[changes], euler[changes], betti[changes], np.zeros(4, np.int64), "radius of the balls")


def _joining(n_nodes: int, first: Integers, second: Integers, values: Floats) -> Floats:
    """The values, ascending, at which components join as the edges (E,) come into a graph in their order."""
    order = np.argsort(values, kind="stable")
    pairs = np.minimum(first, second)[order] * n_nodes + np.maximum(first, second)[order]
    pairs, earliest = np.unique(pairs, return_index=True)
    graph = coo_array((earliest + 1.0, np.divmod(pairs, n_nodes)), shape=(n_nodes, n_nodes))
    tree = minimum_spanning_tree(graph.tocsr())
    return values[order[np.sort(tree.data.astype(np.int64)) - 1]]
