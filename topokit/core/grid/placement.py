"""Where the voxels of a volume are: their sizes, and the coordinates of the scanner or microscope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Floats
from topokit.core.components import Corner
from topokit.core.grid.grid import Grid, Spacing

Index = tuple[int, int, int]
Affine = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Placement:
    """Where the voxels of a volume are.

    Coordinates of a shape run along the axes of the array: origin + spacing × index is the center of a voxel. World
    coordinates are those of the file: affine × (index, 1).

    Attributes:
        spacing: size of a voxel along each axis.
        origin: center of the first voxel in the coordinates of the shape.
        affine: 4 × 4, takes an index to world coordinates; None if the file says nothing about them.
        unit: of spacing and world coordinates, such as "mm"; empty if unknown.
        space: directions of the world's axes, such as "RAS" (to the right, anterior, superior) or "LPS"; empty if
            unknown.
    """

    spacing: Spacing
    origin: Corner = (0.0, 0.0, 0.0)
    affine: Affine | None = None
    unit: str = ""
    space: str = ""

    @classmethod
    def of_affine(cls, affine: Floats, unit: str = "", space: str = "") -> Placement | None:
        """That of a 4 × 4 affine; None if it is degenerate, as in headers that were never filled in."""
        x, y, z = np.linalg.norm(affine[:3, :3], axis=0).tolist()
        if not np.isfinite(affine).all() or min(x, y, z) <= 0:
            return None
        return cls((x, y, z), affine=tuple(map(tuple, affine.tolist())), unit=unit, space=space)

    def grid(self, shape: Sequence[int], first: Index = (0, 0, 0)) -> Grid:
        """The centers of the voxels of a box, by its shape and the index of its first voxel."""
        x, y, z = (start + step * n for start, step, n in zip(self.origin, self.spacing, first, strict=True))
        a, b, c = shape
        return Grid((a, b, c), self.spacing, (x, y, z))

    def voxel(self, point: Sequence[float]) -> Index:
        """The index of the voxel whose center is nearest to a point in the coordinates of the shape."""
        i, j, k = np.rint(self._index(point)).astype(int).tolist()
        return i, j, k

    def world(self, point: Sequence[float]) -> Corner | None:
        """A point in the coordinates of the shape in those of the file; None if the file says nothing about them."""
        if self.affine is None:
            return None
        x, y, z = self.in_file(np.asarray(point, dtype=float)).tolist()
        return x, y, z

    def in_file(self, points: Floats) -> Floats:
        """Points (…, 3) in the coordinates of the shape in those of the file, which are the same if it says nothing."""
        if self.affine is None:
            return points
        affine = np.asarray(self.affine)
        return self._index(points) @ affine[:3, :3].T + affine[:3, 3]

    @property
    def is_mirrored(self) -> bool:
        """Whether the file's coordinates are a mirror image of those of the shape, so that faces have to be turned."""
        return self.affine is not None and bool(np.linalg.det(np.asarray(self.affine)[:3, :3]) < 0)

    def _index(self, point: Sequence[float] | Floats) -> Floats:
        index: Floats = (np.asarray(point, dtype=float) - self.origin) / self.spacing
        return index
