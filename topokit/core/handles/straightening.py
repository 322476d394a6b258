"""Loops along edges made locally shortest: straight across faces, on a strip of the surface around each."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.mesh.connectivity import mesh_connectivity

_WHOLE = 50_000  # faces up to which the whole surface is taken instead of strips
_FIRST_RINGS = 8  # of faces around a loop in the first strip; doubled while the loop leans on the strip's border
_MOST_STEPS = 1_000_000  # of shortening at a corner; a loop of 1000 edges that slides over 500 rows takes half as many
_FLAT = 1e-10  # area over the square of the longest or the usual edge, up to which a triangle counts as having none
_NUDGE = 1e-6  # of the usual edge, by which its corners move


def straightened(vertices: Floats, faces: Integers, loops: list[Integers]) -> list[Floats]:
    """Closed geodesics that loops along edges shorten to, across faces, without leaving their homotopy class.

    Args:
        vertices: (V, 3).
        faces: (F, 3), a connected, closed and oriented manifold.
        loops: vertices (N,) in order of each loop.

    Returns:
        Corners (M, 3) of each on the surface, the first not repeated.

    Reference:
        Sharp and Crane 2020, You can find geodesic paths in triangle meshes by just flipping edges,
        DOI 10.1145/3414685.3417839.
    """
    if len(faces) <= _WHOLE:
        solver = _solver(vertices, faces)
        return [_geodesic(solver, loop) for loop in loops]
    return [_on_strip(vertices, faces, loop) for loop in loops]


def _solver(vertices: Floats, faces: Integers) -> Any:
    import potpourri3d

    return potpourri3d.EdgeFlipGeodesicSolver(_with_area(vertices, faces), faces)


def _geodesic(solver: Any, loop: Integers) -> Floats:
    return np.asarray(solver.find_geodesic_loop(loop.tolist(), max_iterations=_MOST_STEPS))[:-1]


def _with_area(vertices: Floats, faces: Integers) -> Floats:
    """Vertices; those of faces without area are moved by next to nothing: flips need triangles."""
    corners = vertices[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(sides, axis=2)
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    usual = float(np.median(lengths))
    is_flat = areas <= _FLAT * np.maximum(lengths.max(axis=1), usual) ** 2
    if not is_flat.any():
        return vertices
    moved, chosen = vertices.copy(), np.unique(faces[is_flat])
    moved[chosen] += _NUDGE * usual * np.random.default_rng(0).uniform(-1, 1, size=(len(chosen), 3))
    return moved


def _on_strip(vertices: Floats, faces: Integers, loop: Integers) -> Floats:
    """The geodesic on a strip wide enough for it not to lean on the border."""
    near = np.zeros(len(vertices), dtype=bool)
    near[loop] = True
    n_rings = _FIRST_RINGS
    while True:
        for _ in range(n_rings):
            chosen = near[faces].any(axis=1)
            near[faces[chosen]] = True
        points, strip, own_loop, is_border = _strip(vertices, faces[chosen], loop)
        found = _geodesic(_solver(points, strip), own_loop)
        if chosen.all() or not _leans_on(found, points[is_border]):
            return found
        n_rings *= 2


def _strip(vertices: Floats, faces: Integers, loop: Integers) -> tuple[Floats, Integers, Integers, Booleans]:
    """Some faces as a manifold of their own, split where they touch in a vertex only; the loop, and border vertices."""
    mesh = mesh_connectivity(faces)
    corners = mesh.fans
    of_corner = np.zeros(int(corners.max()) + 1, dtype=np.int64)
    of_corner[corners] = faces.ravel()
    index = np.full(len(vertices), -1)
    index[of_corner] = np.arange(len(of_corner))
    is_border = np.zeros(len(of_corner), dtype=bool)
    half = mesh.some_half_edge(mesh.uses == 1)
    is_border[corners[half]] = True
    return vertices[of_corner], corners.reshape(-1, 3), index[loop], is_border


def _leans_on(polygon: Floats, border: Floats) -> bool:
    """Whether any corner of the polygon is a border vertex."""
    if len(border) == 0:
        return False
    return bool((cKDTree(border).query(polygon)[0] == 0).any())
