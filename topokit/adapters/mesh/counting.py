"""Counting a mesh as it was meant: as it stands, or with the vertices merged that were written more than once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.mesh.connectivity import MeshConnectivity, mesh_connectivity
from topokit.core.mesh.topology import MeshTopology, mesh_topology
from topokit.core.mesh.welding import NEARLY_EQUAL, equal_vertices, may_have_near, near_vertices, rounding_radius
from topokit.errors import FOR_POINTS, InputError
from topokit.report.wording import plural


@dataclass(frozen=True)
class CountedMesh:
    """The topology of a mesh under the reading that was chosen.

    Attributes:
        topology: what counting found.
        notes: sentences about what was left out or merged.
        exact_vertices: whether it is beyond doubt which vertices are one. False if the mesh is closed only after
            vertices that nearly coincide were merged, or if it is open and others coincide with some on its boundary.
        faces: (F, 3) the faces that were counted, oriented as given.
    """

    topology: MeshTopology
    notes: tuple[str, ...]
    exact_vertices: bool
    faces: Integers


@dataclass(frozen=True)
class _Reading:
    """One way to read a mesh: which faces are joined, and what it took."""

    connectivity: MeshConnectivity
    notes: tuple[str, ...] = ()
    exact_vertices: bool = True


def count_mesh(vertices: Floats, faces: Integers) -> CountedMesh:
    """Count the mesh as it stands; where it is open, try whether equal vertices are one vertex written twice.

    Args:
        vertices: (V, 3).
        faces: (F, 3).

    Raises:
        InputError: if there are no faces, they name vertices that do not exist, are not finite or all the same, or have
            no area.
    """
    _check(vertices, faces)
    is_used = np.zeros(len(vertices), dtype=bool)
    is_used[faces] = True
    is_proper = _is_proper(faces)
    notes = _leftovers(int((~is_used).sum()), int((~is_proper).sum()))
    faces = faces if is_proper.all() else faces[is_proper]
    if len(faces) == 0:
        raise InputError("every face of the mesh names a vertex twice: nothing is left to count.")
    reading = _best_reading(vertices, faces, is_used)
    topology = mesh_topology(vertices, reading.connectivity.faces, reading.connectivity)
    if not topology.has_area:
        raise InputError("the mesh has no area: all of its faces are degenerate.")
    return CountedMesh(topology, (*notes, *reading.notes), reading.exact_vertices, reading.connectivity.faces)


def _check(vertices: Floats, faces: Integers) -> None:
    if len(faces) == 0:
        raise InputError("the mesh has no faces; for points alone use ", FOR_POINTS, ".")
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(vertices):
        hint = " They seem to be numbered from 1: subtract 1." if (low, high) == (1, len(vertices)) else ""
        raise InputError(
            f"face index {low if low < 0 else high} is out of range: there are "
            f"{plural(len(vertices), 'vertex', 'vertices')}, 0 … {len(vertices) - 1}.{hint}"
        )
    broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    n_broken = int(np.isin(faces, broken).any(axis=1).sum()) if len(broken) else 0
    if n_broken:
        raise InputError(f"{plural(n_broken, 'face')} with vertices that are NaN or infinite; remove them first.")


def _is_proper(faces: Integers) -> Booleans:
    """Faces that name three different vertices."""
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)


def _leftovers(n_unused: int, n_degenerate: int) -> tuple[str, ...]:
    notes = []
    if n_unused:
        notes.append(f"Not counted: {plural(n_unused, 'vertex', 'vertices')} without a face.")
    if n_degenerate:
        notes.append(f"Not counted: {plural(n_degenerate, 'face')} with a repeated vertex.")
    return tuple(notes)


def _best_reading(vertices: Floats, faces: Integers, is_used: Booleans) -> _Reading:
    """As given if that is closed, else with equal vertices merged if that helps, else with nearly equal ones."""
    shares_vertices = int(is_used.sum()) < faces.size
    given = mesh_connectivity(faces) if shares_vertices else None  # loose triangles are open: no need to look
    if given is not None and given.is_closed:
        return _Reading(given)
    used = np.flatnonzero(is_used)
    first = np.arange(len(vertices))
    first[used] = used[equal_vertices(vertices[used])]
    n_merged = _n_moved(first)
    merged = _merged(faces, first) if n_merged else None
    if merged is None:
        best = _Reading(given or mesh_connectivity(faces))
    elif given is None or merged.is_closed or _is_mended(given, merged):
        effect = "which closes the mesh" if merged.is_closed else "which leaves it open"
        note = f"{plural(n_merged, 'vertex', 'vertices')} merged with an equal one, {effect}."
        best = _Reading(merged, (note,))
    else:
        best = _Reading(given)
    if best.connectivity.is_closed:
        return best
    closed = _nearly_closed(vertices, faces, first, merged or best.connectivity)
    return closed or replace(best, exact_vertices=not _boundary_coincides(vertices, best.connectivity))


def _n_moved(first: Integers) -> int:
    return int((first != np.arange(len(first))).sum())


def _merged(faces: Integers, first: Integers) -> MeshConnectivity | None:
    """The mesh with every vertex renamed, or None if no face would be left."""
    renamed = first[faces]
    is_proper = _is_proper(renamed)
    if not is_proper.any():
        return None
    return mesh_connectivity(renamed if is_proper.all() else renamed[is_proper])


def _is_mended(before: MeshConnectivity, after: MeshConnectivity) -> bool:
    """Whether merging removed boundary edges without new faults."""
    faults = [mesh.nonmanifold_edges + len(mesh.pinched) for mesh in (before, after)]
    return after.boundary_edges < before.boundary_edges and faults[1] <= faults[0]


def _nearly_closed(vertices: Floats, faces: Integers, first: Integers, mesh: MeshConnectivity) -> _Reading | None:
    """The mesh with nearly equal vertices merged, if that closes it.

    Args:
        vertices: (V, 3).
        faces: (F, 3) as given.
        first: (V,) the first vertex equal to each.
        mesh: the open mesh with equal vertices merged.
    """
    is_used = np.zeros(len(vertices), dtype=bool)
    is_used[first[faces]] = True
    used = np.flatnonzero(is_used)
    points = vertices[used]
    radius = rounding_radius(points)
    candidates = may_have_near(points, radius)
    may_move = np.zeros(len(vertices), dtype=bool)
    may_move[used[candidates]] = True
    if not may_move[mesh.ends(mesh.uses == 1)].any(axis=1).all():
        return None  # an edge both of whose ends stay where they are stays a boundary edge
    nearest = np.arange(len(vertices))
    nearest[used] = used[near_vertices(points, radius, candidates)]
    first = nearest[first]
    merged = _merged(faces, first)
    if merged is None or not merged.is_closed:
        return None
    note = (
        f"{plural(_n_moved(first), 'vertex', 'vertices')} merged with one within {NEARLY_EQUAL:g} of the diagonal, "
        "which closes the mesh."
    )
    return _Reading(merged, (note,), exact_vertices=False)


def _boundary_coincides(vertices: Floats, mesh: MeshConnectivity) -> bool:
    """Whether a vertex on the boundary lies (nearly) where another vertex does: a seam, or two parts that touch."""
    used = np.unique(mesh.faces)
    points = vertices[used]
    on_boundary = np.isin(used, mesh.ends(mesh.uses == 1))
    radius = rounding_radius(points)
    first = near_vertices(points, radius, may_have_near(points, radius))
    return bool((np.bincount(first)[first[on_boundary]] > 1).any())
