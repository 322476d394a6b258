"""Meshes without boundary, and closed surfaces without narrow handles, tunnels, parts and cavities, as meshes."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from topokit.adapters.mesh.adapter import from_mesh
from topokit.core.arrays import Floats, Integers
from topokit.core.handles.repair import without_boundary
from topokit.core.handles.simplified import without_small_handles
from topokit.core.homotopy.simplified import Way
from topokit.core.loops import middle
from topokit.core.mesh.topology import mesh_topology
from topokit.core.removal import How, Kind, Removal
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError
from topokit.report.progress import progress_bar
from topokit.report.simplification import Simplification
from topokit.shape import Shape
from topokit.shape.surface import closed_surface, mesh_arrays

_UNCHECKED = (
    "Whether the caps of cut handles meet other faces was not checked, because libigl is not installed: pip install "
    '"topokit[defects]".'
)


def simplified_mesh(shape: Shape, below: float, ways: frozenset[Way]) -> Shape:
    """The closed surface of a shape without its narrow features, as a mesh; see `Shape.simplify`.

    Args:
        shape: with a closed surface.
        below: width, in units of length.
        ways: how features may be removed; parts are not joined, and walls of cavities not opened.

    Raises:
        InputError: if there is no closed surface, or every part of it is narrower.
    """
    surface = closed_surface(shape)
    vertices, faces, removals = _without_small_parts(shape.name, surface, below, ways)
    can_check = find_spec("igl") is not None
    of_handles: frozenset[How] = frozenset(how for kind, how in ways if kind == "tunnel")
    if of_handles:
        with progress_bar([shape.name]):
            vertices, faces, more = without_small_handles(vertices, faces, below, of_handles, can_check)
        removals += more
    made = from_mesh(vertices, faces)
    before, after = (one.report().solid_betti for one in (shape, made))
    if before is None or after is None:
        raise AssertionError(f"{shape.name}: a closed mesh has no Betti numbers")
    removals.sort(key=lambda one: (one.width, one.place))
    done = Simplification(below, tuple(removals), before, after, sum(one.changed for one in removals), "face")
    unchecked = (_UNCHECKED,) if removals and not can_check else ()
    notes = (*shape.notes, *made.notes, done.summary(), *unchecked)
    return made.replace(name=shape.name, notes=notes, n_neighbors=shape.n_neighbors, simplification=done)


def without_boundaries(shape: Shape) -> Shape:
    """The mesh with its boundary filled; see `Shape.fill_boundaries`."""
    if shape.mesh is None:
        raise InputError(f"{shape.name} was not made from a mesh, so it has no boundary that could be filled.")
    vertices, faces = mesh_arrays(shape.mesh)
    return mesh_like(shape, *without_boundary(vertices, mesh_topology(vertices, faces)))


def mesh_like(shape: Shape, vertices: Floats, faces: Integers) -> Shape:
    """A mesh (V, 3), (F, 3) with the name of a shape."""
    return from_mesh(vertices, faces).replace(name=shape.name, n_neighbors=shape.n_neighbors)


def _without_small_parts(
    name: str, surface: TriangleSurface, below: float, ways: frozenset[Way]
) -> tuple[Floats, Integers, list[Removal]]:
    """The mesh without the components whose box has a side shorter than a width, which no wider ball fits into."""
    topology = mesh_topology(surface.vertices, surface.faces)
    parts = topology.components
    widths = (parts.high - parts.low).min(axis=1)
    is_cavity = parts.depths % 2 == 1
    is_wanted = np.where(is_cavity, ("cavity", "filled") in ways, ("part", "dropped") in ways)
    is_small = (widths < below) & is_wanted
    if is_small.all():
        raise InputError(
            f"{name}: every part is narrower than {below:g}, so that nothing would be left: "
            "components=False keeps them."
        )
    counts = np.bincount(topology.face_labels, minlength=len(parts))
    removals = []
    for row in np.flatnonzero(is_small):
        place = middle(parts[int(row)].bounds)
        kind: Kind = "cavity" if is_cavity[row] else "part"
        how: How = "filled" if is_cavity[row] else "dropped"
        removals.append(Removal(kind, how, float(widths[row]), place, int(counts[row])))
    if not removals:
        return surface.vertices, topology.faces, []
    kept = TriangleSurface(surface.vertices, topology.faces[~is_small[topology.face_labels]]).compact()
    return kept.vertices, kept.faces, removals
