"""Triangles with their vertices: the form in which every representation gives its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Floats, Integers
from topokit.core.labels import compact_labels


@dataclass(frozen=True, eq=False)
class TriangleSurface:
    """Triangles in space.

    Attributes:
        vertices: (V, 3), in units of length.
        faces: (F, 3) vertex indices, counterclockwise seen from outside the solid.
    """

    vertices: Floats
    faces: Integers

    def compact(self) -> TriangleSurface:
        """The surface without vertices that no face uses."""
        is_used = np.zeros(len(self.vertices), dtype=bool)
        is_used[self.faces] = True
        if is_used.all():
            return self
        return TriangleSurface(self.vertices[is_used], compact_labels(self.faces, len(self.vertices)))


def vector_areas(triangles: Floats) -> Floats:
    """Normals (F, 3) of triangles (F, 3, 3) by the right-hand rule, as long as the triangles' areas."""
    a, b, c = triangles.swapaxes(0, 1)
    areas: Floats = np.cross(b - a, c - a) / 2
    return areas
