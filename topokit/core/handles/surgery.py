"""Cutting surfaces along loops, and capping what is open, by indices; vertices elsewhere stay where they are."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.labels import connected_labels
from topokit.core.mesh.connectivity import MeshConnectivity, edge_keys, mesh_connectivity, next_corner
from topokit.core.mesh.topology import mesh_topology
from topokit.errors import InputError

Arrays = tuple[Floats, Integers]

_RECESSION = 0.1  # of the way to their neighbors that vertices of a cut draw back, so that its two caps do not coincide


def without_loops(vertices: Floats, faces: Integers, loops: list[Integers]) -> Arrays:
    """A closed mesh cut along loops and capped; each loop raises χ by two.

    Args:
        vertices: (V, 3).
        faces: (F, 3), closed and consistently oriented.
        loops: vertices (N,) in order of loops that together do not separate any component.

    Raises:
        InputError: if a loop meets itself or another, or the result does not count to what it should.
    """
    joined = np.concatenate(loops)
    if len(np.unique(joined)) < len(joined):
        raise InputError(
            "the mesh is too coarse to be cut here: the loop along its edges meets itself. Subdivide the mesh, for "
            "example by trimesh's subdivide(), and ask for its handles again."
        )
    points, triangles = cut_and_capped(vertices, faces, loops)
    return counted_cut(vertices, faces, points, triangles, len(loops))


def cut_and_capped(vertices: Floats, faces: Integers, loops: list[Integers]) -> Arrays:
    """The mesh cut along loops, both sides of each cut closed by a fan of triangles around a new vertex.

    The vertices of the loops are doubled, and each copy draws back a little to its own side.

    Args:
        vertices: (V, 3).
        faces: (F, 3), consistently oriented.
        loops: vertices (N,) in order of loops along edges, none of which meets itself or another.

    Returns:
        Vertices, the given ones first, and faces, the given ones first.
    """
    mesh = mesh_connectivity(faces)
    on_loops = edges_of(mesh, loops)
    points, parts = _taken_apart(vertices, mesh, on_loops)
    both = np.concatenate([half[on_loops] for half in mesh.twins])
    moved = np.unique(parts.ravel()[both])
    return capped(_drawn_back(points, parts, moved), parts, both)


def filled(vertices: Floats, faces: Integers) -> Arrays:
    """The mesh with every boundary loop closed by a fan; vertices at which fans of faces meet are doubled.

    Args:
        vertices: (V, 3).
        faces: (F, 3), consistently oriented, at most two at every edge.
    """
    mesh = mesh_connectivity(faces)
    points, parts = _taken_apart(vertices, mesh, np.zeros(len(mesh.twins[0]), dtype=bool))
    return capped(points, parts, mesh.some_half_edge(mesh.uses == 1))


def capped(vertices: Floats, faces: Integers, boundary: Integers) -> Arrays:
    """The mesh with the loops of its boundary closed: by one triangle, or by several around their centroid.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        boundary: half-edges without a neighbor, see `MeshConnectivity`, that form loops.
    """
    corners = faces.ravel()
    after = dict(zip(corners[boundary].tolist(), corners[next_corner(boundary)].tolist(), strict=True))
    points, triangles = [vertices], [faces]
    n_points = len(vertices)
    while after:
        start = next(iter(after))
        loop = [start]
        while (vertex := after.pop(loop[-1])) != start:
            loop.append(vertex)
        ends = np.array(loop)
        if len(ends) == 3:
            triangles.append(ends[None, ::-1])
            continue
        points.append(_centroid(vertices[ends])[None])
        triangles.append(np.stack((np.roll(ends, -1), ends, np.full(len(ends), n_points)), axis=1))
        n_points += 1
    return np.concatenate(points), np.concatenate(triangles)


def _centroid(polygon: Floats) -> Floats:
    """Center of mass of a closed polygon's sides."""
    ends = np.roll(polygon, -1, axis=0)
    lengths = np.linalg.norm(ends - polygon, axis=1)
    total = lengths.sum()
    return (lengths @ (polygon + ends)) / (2 * total) if total else polygon[0]


def edges_of(mesh: MeshConnectivity, loops: list[Integers]) -> Booleans:
    """Which edges with two faces are on the loops."""
    half, n_vertices = mesh.twins[0], mesh.n_vertices
    corners = mesh.faces.ravel()
    first, second = corners[half], corners[next_corner(half)]
    starts, ends = np.concatenate(loops), np.concatenate([np.roll(loop, -1) for loop in loops])
    return np.isin(edge_keys(first, second, n_vertices), edge_keys(starts, ends, n_vertices))


def _taken_apart(vertices: Floats, mesh: MeshConnectivity, is_cut: Booleans) -> Arrays:
    """The mesh with a vertex of its own for each fan of faces that is left when edges are cut."""
    corners = mesh.faces.ravel()
    first, second = (half[~is_cut] for half in mesh.twins)
    fans = connected_labels(
        len(corners), np.concatenate((first, next_corner(first))), np.concatenate((next_corner(second), second))
    )
    of_fan = np.empty(int(fans.max()) + 1, dtype=np.int64)
    of_fan[fans] = corners
    order = np.argsort(of_fan, kind="stable")
    is_further = np.concatenate(([False], of_fan[order][1:] == of_fan[order][:-1]))
    further = order[is_further]
    index = of_fan.copy()
    index[further] = len(vertices) + np.arange(len(further))
    return np.concatenate((vertices, vertices[of_fan[further]])), index[fans].reshape(-1, 3)


def _drawn_back(vertices: Floats, faces: Integers, chosen: Integers) -> Floats:
    """Vertices with the chosen ones moved toward the mean of their neighbors that are not chosen."""
    is_chosen = np.zeros(len(vertices), dtype=bool)
    is_chosen[chosen] = True
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    leads_off = is_chosen[tails] & ~is_chosen[heads]
    tails, heads = tails[leads_off], heads[leads_off]
    counts = np.bincount(tails, minlength=len(vertices))
    moved = vertices.copy()
    own = np.flatnonzero(counts)
    sums = np.stack([np.bincount(tails, vertices[heads, axis], len(vertices)) for axis in range(3)], axis=1)
    moved[own] += _RECESSION * (sums[own] / counts[own, None] - vertices[own])
    return moved


def counted_cut(vertices: Floats, faces: Integers, points: Floats, triangles: Integers, n_loops: int) -> Arrays:
    """A mesh that was cut along loops, if each raised χ by two and none took a component apart.

    Raises:
        InputError: if not.
    """
    before, after = mesh_topology(vertices, faces), mesh_topology(points, triangles)
    euler = before.euler + 2 * n_loops
    is_whole = after.is_closed and not after.flipped_faces and len(after.components) == len(before.components)
    if not is_whole or after.euler != euler:
        raise InputError(
            f"the mesh cannot be cut along this loop: χ = {euler} was expected, and the result counts to {after.euler}."
        )
    return points, triangles
