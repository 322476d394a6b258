"""The handles of a closed surface: for each a short loop that bounds inside and one that bounds outside."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter

import numpy as np
from scipy.optimize import linear_sum_assignment

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.handles.cycle_basis import CycleBasis, edge_graph
from topokit.core.handles.handle import Handle, Made
from topokit.core.handles.linking import decided_basis
from topokit.core.handles.short_loops import SurfaceLoop, short_loops
from topokit.core.handles.straightening import straightened
from topokit.core.handles.surgery import Arrays
from topokit.core.loops import bounds_of
from topokit.core.mesh.topology import MeshTopology
from topokit.errors import InputError


def find_handles(
    vertices: Floats, topology: MeshTopology, made: Callable[[Floats, Integers], Made]
) -> list[Handle[Made]]:
    """The handles of a closed mesh, smallest first.

    The loops of each side are a basis of the classes that bound there; both together are a basis of all. Each component
    is treated as if the others were not there.

    Args:
        vertices: (V, 3).
        topology: of the mesh, which is closed.
        made: what vertices and faces become where a handle is cut or filled.

    Raises:
        InputError: if a component intersects itself, so that inside and outside are not defined.
    """
    found: list[Handle[Made]] = []
    for component in np.flatnonzero(topology.components.genera > 0):
        found += _handles_of((vertices, topology.faces), topology.face_labels == component, int(component), made)
    return sorted(found, key=attrgetter("size"))


def _handles_of(
    mesh: Arrays, is_own: Booleans, component: int, made: Callable[[Floats, Integers], Made]
) -> list[Handle[Made]]:
    """The handles of one component, whose faces are given as a mask (F,)."""
    names, faces = np.unique(mesh[1][is_own], return_inverse=True)
    vertices, faces = mesh[0][names], faces.reshape(-1, 3)
    decided = decided_basis(vertices, edge_graph(vertices, faces))
    if decided is None:
        raise InputError(
            f"component {component} of the surface intersects itself, so that its inside and outside are not defined "
            "and its handles cannot be told from its tunnels: remove the self-intersections first."
        )
    basis, projector = decided
    inside, outside = short_loops(basis, projector)
    curves = straightened(vertices, faces, [loop.vertices for loop in (*inside, *outside)])
    lengths = [_perimeter(curve) for curve in curves]
    return [
        Handle(
            handle_loop=curves[i],
            tunnel_loop=curves[len(inside) + j],
            handle_length=lengths[i],
            tunnel_length=lengths[len(inside) + j],
            bounds=bounds_of(np.concatenate((curves[i], curves[len(inside) + j]))),
            component=component,
            handle_vertices=names[inside[i].vertices],
            tunnel_vertices=names[outside[j].vertices],
            _mesh=mesh,
            _made=made,
        )
        for i, j in _pairs(basis, inside, outside, lengths)
    ]


def _perimeter(polygon: Floats) -> float:
    return float(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum())


def _pairs(
    basis: CycleBasis, inside: list[SurfaceLoop], outside: list[SurfaceLoop], lengths: list[float]
) -> list[tuple[int, int]]:
    """Loops inside and outside that cross each other once, of similar length where there is a choice.

    The numbers of crossings form a matrix of determinant ±1, so a pairing of loops that cross always exists; one in
    which some cross more than once is taken only if there is no other.
    """
    crossings = intersection_numbers(basis, inside, outside)
    sizes = np.array(lengths)
    cost = np.maximum.outer(sizes[: len(inside)], sizes[len(inside) :]) / sizes.max()
    worst = 1.0 + len(inside)
    cost += np.select([np.abs(crossings) == 1, crossings != 0], [0.0, worst], worst * worst)
    return [(int(i), int(j)) for i, j in zip(*linear_sum_assignment(cost), strict=True)]


def intersection_numbers(basis: CycleBasis, first: list[SurfaceLoop], second: list[SurfaceLoop]) -> Integers:
    """How often each loop of one list crosses each of another (m, n), signed."""
    own, other = (np.stack([loop.own_class for loop in loops]) for loops in (first, second))
    return own @ basis.intersections @ other.T
