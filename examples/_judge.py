"""Count of surfaces by marching cubes and V − E + F, independent of topokit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skimage.measure import marching_cubes

_LISTED = 3  # surfaces described one by one


def describe_surfaces(field: ArrayLike) -> str:
    """One line on the surfaces of the solid {field > 0}: their number, and V − E + F and genus of the largest.

    Args:
        field: (X, Y, Z), positive inside; outside the grid there is only background.
    """
    padded = np.pad(np.asarray(field, dtype=np.float64), 1, constant_values=-1.0)
    if not (padded > 0).any():
        return "0 surfaces"
    faces = marching_cubes(padded, 0.0)[1].astype(np.int64)
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    n_vertices = int(faces.max()) + 1
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(n_vertices, n_vertices))
    n_surfaces, owner = connected_components(graph, directed=False)
    counts = [np.bincount(owner[of], minlength=n_surfaces) for of in (np.arange(n_vertices), edges[:, 0], faces[:, 0])]
    sizes = sorted(zip(*(count.tolist() for count in counts), strict=True), reverse=True)
    described = [f"{v} − {e} + {f} = {v - e + f}, genus {(2 - (v - e + f)) // 2}" for v, e, f in sizes[:_LISTED]]
    if n_surfaces > _LISTED:
        described.append(f"and {n_surfaces - _LISTED} smaller")
    return f"{n_surfaces} surface{'s'[: n_surfaces != 1]}: " + "; ".join(described)
