"""Meshes without boundary, and closed surfaces without narrow handles, tunnels, parts and cavities, as meshes."""

from __future__ import annotations

import math
from importlib.util import find_spec

import numpy as np

from topokit.adapters.mesh.adapter import from_mesh
from topokit.core.arrays import Floats, Integers
from topokit.core.handles.repair import without_boundary
from topokit.core.handles.simplified import Round, without_small_handles
from topokit.core.homotopy.simplified import Way
from topokit.core.loops import middle
from topokit.core.mesh.topology import mesh_topology
from topokit.core.removal import How, Kind, Removal
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError, Interrupted
from topokit.report.progress import progress_bar
from topokit.report.report import Betti
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
    before = shape.report().solid_betti
    if before is None:
        raise AssertionError(f"{shape.name}: a closed mesh has no Betti numbers")
    vertices, faces, removals = _without_small_parts(shape.name, surface, below, ways)
    can_check = find_spec("igl") is not None
    of_handles: frozenset[How] = frozenset(how for kind, how in ways if kind == "tunnel")
    done = Round(vertices, faces, [], math.inf)
    if of_handles:
        try:
            with progress_bar([shape.name]):
                for done in without_small_handles(vertices, faces, below, of_handles, can_check):  # noqa: B007
                    pass
        except KeyboardInterrupt as interrupt:
            raise Interrupted(_made(shape, below, before, removals, done, can_check)) from interrupt
    return _made(shape, below, before, removals, done, can_check)


def _made(shape: Shape, below: float, before: Betti, removals: list[Removal], done: Round, was_checked: bool) -> Shape:
    """The mesh after a round, with what was removed before and in the rounds."""
    made = from_mesh(done.vertices, done.faces)
    after = made.report().solid_betti
    if after is None:
        raise AssertionError(f"{shape.name}: a closed mesh has no Betti numbers")
    removed = removals + done.removals
    told = Simplification.of(below, removed, before, after, sum(one.changed for one in removed), "face", done.narrowest)
    unchecked = (_UNCHECKED,) if removed and not was_checked else ()
    notes = (*shape.notes, *made.notes, told.summary(), *unchecked)
    return made.replace(name=shape.name, notes=notes, n_neighbors=shape.n_neighbors, simplification=told)


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
