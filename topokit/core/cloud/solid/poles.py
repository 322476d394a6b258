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

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.normals.patches import turned_towards, unit
from topokit.core.cloud.settings import CutWeights
from topokit.core.cloud.solid.tetrahedra import Cut, DelaunayComplex, cut_complex, surface_normals


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
    everything = np.ones(len(complex_.tetrahedra), dtype=bool)  # bounded by the convex hull
    outward, is_on_hull = surface_normals(complex_, everything, np.zeros_like(complex_.points))
    return OuterPoles(np.where(is_on_hull, -1, tetrahedron), np.where(is_on_hull[:, None], outward, way))


def normals_by_poles(
    complex_: DelaunayComplex, normals: Floats, cut: Cut, weights: CutWeights, rounds: int, axes: Floats | None = None
) -> tuple[Floats, Cut]:
    """Outward normals (N, 3) whose signs are those of the poles in the solid that they imply, and its cut.

    Needs samples without noise: with it the small spheres are what is missing, and ways to poles are no normals.

    Args:
        complex_: tetrahedra of N samples.
        normals: (N, 3), unit, most of them outward.
        cut: of these normals.
        weights: of the cuts.
        rounds: how often poles are labeled anew; more than two change nothing.
        axes: (N, 3), unit normals of arbitrary sign, where known.
    """
    poles = outer_poles(complex_)
    for _ in range(rounds):
        surface, is_on = surface_normals(complex_, cut.inside, normals)
        outward = poles.signed(cut)
        mean = unit(np.where(is_on[:, None], surface, 0) + outward + 1e-9 * poles.way)
        normals = turned_towards(mean if axes is None else axes, outward)
        cut = cut_complex(complex_, normals, weights)
    return normals, cut
