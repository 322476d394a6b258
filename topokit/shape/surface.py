"""Where a shape ends and what it encloses: its closed surface, checked against the report, and its boundary curves."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from torch import Tensor

from topokit.core.arrays import Floats, Integers
from topokit.core.loops import BoundaryLoop
from topokit.core.mesh.boundary_loops import mesh_boundary
from topokit.core.mesh.topology import mesh_topology
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError
from topokit.report.open_surface import open_surfaces
from topokit.report.report import TopologyReport, why
from topokit.report.wording import plural

if TYPE_CHECKING:
    from topokit.shape.shape import Shape


def closed_surface(shape: Shape) -> TriangleSurface:
    """The closed surface that a shape's report is about; see `checked_surface`."""
    return checked_surface(shape.report(), found_surface(shape))


def checked_surface(report: TopologyReport, surface: TriangleSurface | None) -> TriangleSurface:
    """The surface that a report is about, facing outward.

    Args:
        report: of a shape.
        surface: what was found for it, or None.

    Raises:
        InputError: if there is none, or it is open, not a manifold or does not count to the report's integer.
    """
    if surface is None or len(surface.faces) == 0 or not report.closed:
        ends = f"It ends along {plural(report.boundary_loops, 'boundary loop')}. " if report.boundary_loops else ""
        raise InputError(f"{report.name} has no closed surface. {ends}{why(report)}")
    topology = mesh_topology(surface.vertices, surface.faces)
    if not topology.is_closed or topology.euler != report.euler:
        found = f"counts to χ = {topology.euler}" if topology.is_closed else "is not a closed manifold"
        raise InputError(
            f"{report.name}: the surface that was found {found}, but χ = {report.euler} ({report.verdict}) is "
            f"reported, so it is not given. {why(report)}"
        )
    return TriangleSurface(surface.vertices, topology.faces)


def surface_with_rims(shape: Shape) -> TriangleSurface:
    """The surface that a shape's report is about: closed, or that of an open cloud without what closes its holes.

    Raises:
        InputError: as for `checked_surface`; or if what is left of an open cloud has not the reported numbers.
    """
    report = shape.report()
    if report.closed or shape.counted is not None:
        return checked_surface(report, found_surface(shape))
    expected = report.euler, report.components, report.boundary_loops
    trials = [one.triangles for one in open_surfaces(shape._known.examination()) if one.triangles is not None]
    counts = [_open_counts(surface) for surface in trials]
    if expected in counts:
        return trials[counts.index(expected)].compact()
    if not trials:
        return checked_surface(report, None)
    raise InputError(
        f"{report.name}: without what closes its holes, the surface that was found has χ, components and boundary "
        f"loops {counts[0]}, but {expected} are reported ({report.verdict}), so it is not given. {why(report)}"
    )


def _open_counts(surface: TriangleSurface) -> tuple[int, int, int]:
    topology = mesh_topology(surface.vertices, surface.faces)
    return topology.euler, len(topology.components), topology.boundary_loops


def boundary_of(shape: Shape) -> tuple[BoundaryLoop, ...]:
    """The curves along which a shape's surface ends, longest first; see `Shape.boundaries`.

    Those of samples are as long as curves smoothed over three spacings, since points of a rim lie in a zigzag.
    """
    if shape.mesh is not None:
        return mesh_boundary(*mesh_arrays(shape.mesh))
    if shape.counted is not None:
        if shape.counted.closed:
            return ()
        raise InputError(
            f"{shape.name} is cut by the box in which it was looked for, and its curves there are not traced: pass "
            "larger bounds."
        )
    found = shape._known.examination()
    points = found.samples.points.cpu().double().numpy()
    return tuple(
        replace(BoundaryLoop.through(points, curve.index.numpy()), length=curve.length)
        for curve in found.boundary.curves
    )


def found_surface(shape: Shape) -> TriangleSurface | None:
    """The closed surface as triangles, not compared with the report; None if there is none."""
    if shape._make_surface is not None:
        return shape._make_surface()
    if shape.mesh is not None:
        return TriangleSurface(*mesh_arrays(shape.mesh)).compact()
    found = shape._known.examination()
    witness, opacity = found.witness, found.opacity
    if witness is None or witness.surface is None:
        return None
    misses = witness.surface.euler != witness.euler
    if opacity is not None and (found.opaque or (misses and opacity.euler == witness.euler)):
        return opacity.surface
    return found.surface


def mesh_arrays(mesh: tuple[Tensor, Tensor]) -> tuple[Floats, Integers]:
    """Vertices (V, 3) and faces (F, 3) of a shape's mesh, detached, in double precision."""
    vertices, faces = (part.detach().cpu().numpy() for part in mesh)
    return vertices.astype(np.float64), faces
