"""Closed triangle surfaces, and the check that one counts to a given Euler characteristic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topokit.core.labels import compact_labels, count_distinct

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TriangleSurface:
    """Triangles with their vertices.

    Attributes:
        vertices: (V, 3), in units of length.
        faces: (F, 3) vertex indices, counterclockwise seen from outside the solid.
    """

    vertices: Floats
    faces: Integers

    @property
    def euler(self) -> int:
        """V − E + F, vertices without a face left out."""
        if len(self.faces) == 0:
            return 0
        ends = np.roll(self.faces, -1, axis=1)
        keys = np.minimum(self.faces, ends) * (int(self.faces.max()) + 1) + np.maximum(self.faces, ends)
        return count_distinct(self.faces.ravel()) - count_distinct(keys.ravel()) + len(self.faces)

    def compact(self) -> TriangleSurface:
        """The surface without vertices that no face uses."""
        is_used = np.zeros(len(self.vertices), dtype=bool)
        is_used[self.faces] = True
        if is_used.all():
            return self
        return TriangleSurface(self.vertices[is_used], compact_labels(self.faces, len(self.vertices)))
