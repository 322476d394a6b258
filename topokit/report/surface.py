"""The closed surface behind a report: triangles whose V − E + F is the reported integer, or why there are none."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from torch import Tensor

from topokit.core.mesh.connectivity import mesh_connectivity
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError
from topokit.report.report import TopologyReport


class HasSurface(Protocol):
    """What a surface is taken from: a `topokit.Shape`."""

    @property
    def mesh(self) -> tuple[Tensor, Tensor] | None: ...

    def report(self) -> TopologyReport: ...


def reported_surface(shape: HasSurface) -> TriangleSurface:
    """The closed surface that the shape's report is about, checked against the report.

    Raises:
        InputError: if the surface is open, not a manifold, or does not count to the reported integer.
    """
    report = shape.report()
    if not report.closed or report.euler is None:
        raise InputError(f"{report.name} has no closed surface. {' '.join(report.reasons)}")
    if shape.mesh is None:
        raise InputError(f"{report.name} was not made from a mesh, so its surface is not known as triangles.")
    vertices, faces = shape.mesh
    surface = TriangleSurface(
        np.asarray(vertices.detach().cpu().numpy(), dtype=np.float64), faces.cpu().numpy().astype(np.int64)
    )
    return _checked(surface.compact(), report)


def _checked(surface: TriangleSurface, report: TopologyReport) -> TriangleSurface:
    """The surface itself if it is a closed manifold that counts to the report's integer."""
    is_closed = len(surface.faces) > 0 and mesh_connectivity(surface.faces).is_closed
    if not is_closed or surface.euler != report.euler:
        found = f"counts to V − E + F = {surface.euler}" if is_closed else "is not a closed manifold"
        raise InputError(
            f"{report.name}: the surface that was found {found}, while the report says χ = {report.euler} "
            f"({report.verdict}), so it is not returned."
        )
    return surface
