"""The boundary of a triangle mesh as curves."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Floats, Integers
from topokit.core.loops import BoundaryLoop
from topokit.core.mesh.connectivity import mesh_connectivity, next_corner


def mesh_boundary(vertices: Floats, faces: Integers) -> tuple[BoundaryLoop, ...]:
    """The curves of edges that have one face, longest first; at a pinched vertex they do not cross from fan to fan.

    Args:
        vertices: (V, 3).
        faces: (F, 3).

    Returns:
        As many as `MeshTopology.boundary_loops` if the mesh is a manifold. Where non-manifold edges reach the boundary,
        a curve may end there; it is not closed then.
    """
    mesh = mesh_connectivity(faces)
    half = mesh.some_half_edge(mesh.uses == 1)
    ends = np.stack((half, next_corner(half)), axis=1).ravel()  # corners: edge e has the ends 2 e and 2 e + 1
    point = faces.ravel()[ends]
    curves = _curves(mesh.fans[ends])
    loops = [BoundaryLoop.through(vertices, point[path], closed) for path, closed in curves]
    return tuple(sorted(loops, key=lambda loop: -loop.length))


def _curves(fans: Integers) -> list[tuple[list[int], bool]]:
    """Edges joined where their ends share a fan: the ends (2 E,) that each curve passes, and whether it is closed."""
    by_fan = np.argsort(fans, kind="stable")
    waiting = [part.tolist() for part in np.split(by_fan, np.flatnonzero(np.diff(fans[by_fan])) + 1)]
    place = np.empty(len(fans), dtype=np.int64)
    place[by_fan] = np.repeat(np.arange(len(waiting)), [len(part) for part in waiting])
    is_even = np.array([len(part) % 2 == 0 for part in waiting])[place]
    at, is_free = place.tolist(), [True] * (len(fans) // 2)
    curves = []
    for start in np.argsort(is_even, kind="stable").tolist():  # fans with an odd number of ends begin open curves
        if is_free[start // 2]:
            curves.append(_curve(start, at, waiting, is_free))
    return curves


def _curve(start: int, at: list[int], waiting: list[list[int]], is_free: list[bool]) -> tuple[list[int], bool]:
    """The ends from which the edges of one curve are left, and whether it comes back; its edges are taken."""
    path, end = [start], start
    while True:
        is_free[end // 2] = False
        arrived = end ^ 1
        others = waiting[at[arrived]]
        while others and not is_free[others[-1] // 2]:
            others.pop()
        if not others:
            is_closed = at[arrived] == at[start]
            return (path if is_closed else [*path, arrived]), is_closed
        end = others.pop()
        path.append(end)
