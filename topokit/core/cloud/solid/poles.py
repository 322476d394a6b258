"""Signs from empty spheres: each sample's largest one tells on which side of the surface its center lies.

The largest empty sphere that touches a sample has its center, the sample's outer pole, far from the surface, and the
way there is nearly normal to it, also where an opposite sheet is nearer than the next sample of the own one. Large
spheres are what a cut labels rightly even where it joins thin walls or fills narrow gaps. So the labels of the poles
give signs that are better than those the cut was made with.

Reference:
    N. Amenta, S. Choi, R. K. Kolluri, "The power crust", SMA 2001, doi:10.1145/376957.376986, for poles and labels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.normals.patches import turned_towards, unit
from topokit.core.cloud.solid.tetrahedra import FACETS, Cut, DelaunayComplex, cut_complex, surface_normals

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class OuterPoles:
    """The largest empty spheres at N samples.

    Attributes:
        tetrahedron: (N,), the one whose circumsphere it is; −1 on the convex hull, where it has no end.
        way: (N, 3), unit, from the sample to the center; on the hull outward.
    """

    tetrahedron: Integers
    way: Floats

    def signed(self, cut: Cut) -> Floats:
        """Outward directions (N, 3): towards poles outside the solid, away from poles inside."""
        is_inside = np.append(cut.inside, False)[self.tetrahedron]  # index −1 is the appended outside
        return np.where(is_inside[:, None], -self.way, self.way)


def outer_poles(complex_: DelaunayComplex) -> OuterPoles:
    """The largest empty sphere at every sample of a complex."""
    first = complex_.points[complex_.tetrahedra[:, 0]]
    order = np.argsort(np.linalg.norm(complex_.centers - first, axis=1), kind="stable")
    tetrahedron = np.zeros(len(complex_.points), dtype=np.int64)
    tetrahedron[complex_.tetrahedra[order].ravel()] = np.repeat(order, 4)  # of several the last one stays: the largest
    way = unit(complex_.centers[tetrahedron] - complex_.points)
    outward = _hull_normals(complex_)
    is_on_hull = (outward != 0).any(1)
    return OuterPoles(np.where(is_on_hull, -1, tetrahedron), np.where(is_on_hull[:, None], outward, way))


def _hull_normals(complex_: DelaunayComplex) -> Floats:
    """Outward area-weighted unit normals (N, 3) of the convex hull, zero at other points."""
    tetrahedron, corner = np.nonzero(complex_.neighbors < 0)
    area = complex_.facet_area[tetrahedron, corner][:, None] * complex_.facet_normal[tetrahedron, corner]
    vertices = complex_.tetrahedra[tetrahedron[:, None], FACETS[corner]].ravel()
    count = len(complex_.points)
    return unit(np.stack([np.bincount(vertices, np.repeat(area[:, axis], 3), count) for axis in range(3)], 1))


def normals_by_poles(
    complex_: DelaunayComplex, normals: Floats, cut: Cut, rounds: int, axes: Floats | None = None
) -> tuple[Floats, Cut]:
    """Outward normals (N, 3) whose signs are those of the poles in the solid that they imply, and its cut.

    Needs samples without noise: with it the small spheres are what is missing, and ways to poles are no normals.

    Args:
        complex_: tetrahedra of N samples.
        normals: (N, 3), unit, most of them outward.
        cut: of these normals.
        rounds: how often poles are labeled anew; more than two change nothing.
        axes: (N, 3), unit normals of arbitrary sign, where known.
    """
    poles = outer_poles(complex_)
    for _ in range(rounds):
        surface, is_on = surface_normals(complex_, cut.inside, normals)
        outward = poles.signed(cut)
        mean = unit(np.where(is_on[:, None], surface, 0) + outward + 1e-9 * poles.way)
        normals = turned_towards(mean if axes is None else axes, outward)
        cut = cut_complex(complex_, normals)
    return normals, cut
