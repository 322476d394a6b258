"""What the surface of an open cloud can be: a solid with lids, a sheet, or a solid whose holes planar caps close."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.cloud.settings import QualitySettings
from topokit.core.cloud.solid.surface import CutSurface
from topokit.core.cloud.witness import Witness
from topokit.core.genus import fitting_genus, genus_of
from topokit.core.labels import connected_labels
from topokit.core.mesh.boundary_loops import mesh_boundary
from topokit.core.mesh.connectivity import mesh_connectivity
from topokit.core.mesh.topology import mesh_topology
from topokit.core.neighbors import neighbor_components
from topokit.core.surface import TriangleSurface
from topokit.report.examination import Examination
from topokit.report.verdict import cloud_verdict, is_mostly_seen, lids


@dataclass(frozen=True, eq=False)
class OpenSurface:
    """An open surface by its rims.

    Attributes:
        components: parts of the surface.
        euler: its own if it was counted, else the nearest to what was measured that a surface with so many parts and
            rims has.
        rims: points (N, 3) of those that could be traced, the widest first.
        of_sheet: whether it is a sheet rather than a solid with holes.
        is_counted: whether it is what was seen of the surface that planar caps close.
        capped_genus: handles of that surface, or None if there is none: then a disc in every rim is assumed.
        triangles: what was seen of the surface that was found, facing outward; None if none was.
    """

    components: int
    euler: int
    rims: tuple[Floats, ...]
    of_sheet: bool
    is_counted: bool = False
    capped_genus: int | None = None
    triangles: TriangleSurface | None = None

    @property
    def widths(self) -> tuple[float, ...]:
        """The longest sides of the boxes around the rims."""
        return tuple(_width(rim) for rim in self.rims)

    @property
    def disc_genus(self) -> int | None:
        """Handles with a disc in every rim, or None if no orientable surface has these numbers, or no rim is known."""
        return fitting_genus(self.euler, len(self.rims), self.components) if self.rims else None

    @property
    def genus(self) -> int | None:
        """Handles with its holes closed, by the caps if these were found, else by discs."""
        return self.disc_genus if self.capped_genus is None else self.capped_genus

    @property
    def has_ring(self) -> bool:
        """Whether the caps give another genus than discs: one has several rims, as under a ring on a table."""
        return self.genus != self.disc_genus

    def with_euler(self, euler: int) -> OpenSurface:
        """The surface with another χ, unless its own was counted, or no surface with these rims has it."""
        fits = self.of_sheet or fitting_genus(euler, len(self.rims), self.components) is not None
        return replace(self, euler=euler) if fits and not self.is_counted else self


def open_surfaces(found: Examination) -> list[OpenSurface]:
    """What the surface can be, the most plausible first.

    χ of a solid with lids is that of the votes, less one for every lid; that of the sheet, whose parts are those of the
    cloud, is near the estimate. The solid comes first if most of its surface was seen, that with planar caps last: its
    rims are less often right, but its genus is known without them.
    """
    witness, curves = found.witness, found.part.boundary.curves
    covers, trials = lids(witness), []
    if curves or witness is None:
        rims = [found.part.positions(curve.index.numpy()) for curve in curves]
        n_parts = int(neighbor_components(found.part.neighbors).max()) + 1
        trials.append(_fitted(n_parts, len(curves), found.part.estimate, rims, True))
    if witness is not None and (covers or not curves):
        is_solid = is_mostly_seen(witness)
        rims = [found.positions(cover.samples) for cover in covers] if is_solid else []
        euler = float(_solid_euler(witness) - len(covers))
        n_surfaces, triangles = witness.components + witness.cavities, _without_lids(found, witness)
        solid = _fitted(n_surfaces, len(covers), euler, rims, not is_solid, triangles)
        trials.insert(0 if is_solid else len(trials), solid)
    capped = _capped_surface(found)
    if capped is None:
        return trials
    return [*(replace(one, capped_genus=capped.capped_genus) for one in trials), capped]


def _fitted(
    components: int,
    discs: int,
    nearest: float,
    rims: list[Floats],
    of_sheet: bool,
    triangles: TriangleSurface | None = None,
) -> OpenSurface:
    most = 2 * components - discs
    euler = min(most, most - 2 * round((most - nearest) / 2))
    return OpenSurface(components, euler, _widest_first(rims), of_sheet, triangles=triangles)


def _solid_euler(witness: Witness) -> int:
    """χ of the votes, or, where no solid has it, that of the first cut, whose parts are counted."""
    return witness.euler if witness.has_genus or witness.surface is None else witness.surface.euler


def _without_lids(found: Examination, witness: Witness) -> TriangleSurface | None:
    surface = found.surface
    if surface is None or not witness.lids:
        return None
    is_seen = np.ones(len(surface.faces), dtype=bool)
    is_seen[np.concatenate([patch.facets for patch in witness.lids])] = False
    return _taken_apart(surface.vertices, surface.faces[is_seen]) if is_seen.any() else None


def _capped_surface(found: Examination) -> OpenSurface | None:
    """The surface that planar caps close, without them; None if they close none whose integer is likely."""
    capped = found.capped
    if capped is None or (witness := capped.witness) is None or cloud_verdict(capped.checks) == "unsure":
        return None
    surface, n_surfaces = witness.surface, witness.components + witness.cavities
    if surface is None or surface.euler != witness.euler:
        return None
    seen = surface.faces[~_is_cap(surface, found.samples.n_points)]
    if not 0 < len(seen) < len(surface.faces):
        return None
    triangles = _taken_apart(capped.positions(surface.points), seen)
    topology = mesh_topology(triangles.vertices, triangles.faces)
    return OpenSurface(
        components=len(topology.components),
        euler=topology.euler,
        rims=_widest_first([loop.points for loop in mesh_boundary(triangles.vertices, triangles.faces)]),
        of_sheet=False,
        is_counted=True,
        capped_genus=genus_of(witness.euler, components=n_surfaces),
        triangles=triangles,
    )


def _is_cap(surface: CutSurface, first_cap: int) -> Booleans:
    """Which faces (F,) belong to caps, whose samples have indices from `first_cap` on.

    A patch of a cap, or of what was seen inside it, with fewer samples than a hole is no patch of its own.
    """
    is_cap: Booleans = np.any(surface.points[surface.faces] >= first_cap, axis=1)
    for kind in (True, False):
        rows = np.flatnonzero(is_cap == kind)
        label, n_vertices = _patches(surface.faces[rows], len(surface.points))
        is_cap[rows[n_vertices[label] < QualitySettings().lid]] = not kind
    return is_cap


def _patches(faces: Integers, n_vertices: int) -> tuple[Integers, Integers]:
    """The patch (F,) of each face, faces with a common vertex in one; and the number of vertices of each patch."""
    a, b, c = faces.T
    label = connected_labels(n_vertices, np.concatenate((a, b)), np.concatenate((b, c)))
    return label[a], np.bincount(label)


def _taken_apart(vertices: Floats, faces: Integers) -> TriangleSurface:
    """The surface with one vertex for every fan of faces."""
    fans = mesh_connectivity(faces).fans
    own = np.empty(int(fans.max()) + 1, dtype=np.int64)
    own[fans] = faces.ravel()
    return TriangleSurface(vertices[own], fans.reshape(-1, 3))


def _widest_first(rims: list[Floats]) -> tuple[Floats, ...]:
    return tuple(sorted(rims, key=_width, reverse=True))


def _width(points: Floats) -> float:
    """The longest side of the box of some points."""
    return float(np.ptp(points, axis=0).max())
