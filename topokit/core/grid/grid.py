"""Regular grids in space: where the values of a field are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from scipy.fft import next_fast_len
from torch import Tensor

from topokit.core.components import Corner
from topokit.errors import InputError

Spacing = tuple[float, float, float]

_FEWEST_CELLS = 8  # along any side of a box, however thin
_FEWEST_VERTICES = 8  # along any axis of a grid for Fourier transforms


@dataclass(frozen=True)
class Grid:
    """The vertices of a regular grid along the coordinate axes.

    Attributes:
        shape: vertices along each axis.
        spacing: step along each axis, in units of length.
        origin: position of vertex (0, 0, 0).
    """

    shape: tuple[int, int, int]
    spacing: Spacing = (1.0, 1.0, 1.0)
    origin: Corner = (0.0, 0.0, 0.0)

    @classmethod
    def covering(cls, low: Corner, high: Corner, n_cells: int) -> Grid:
        """The grid on a box with `n_cells` along its longest side and nearly cubic cells, at least 8 along each side.

        Args:
            low: lowest corner of the box.
            high: highest corner of the box.
            n_cells: cells along the longest side.
        """
        sides = [b - a for a, b in zip(low, high, strict=True)]
        x, y, z = (max(_FEWEST_CELLS, round(n_cells * side / max(sides))) for side in sides)
        return cls((x + 1, y + 1, z + 1), (sides[0] / x, sides[1] / y, sides[2] / z), low)

    @property
    def n_vertices(self) -> int:
        """Vertices in all."""
        return math.prod(self.shape)

    @property
    def n_cells(self) -> int:
        """Cells along the longest axis."""
        return max(self.shape) - 1

    @property
    def step(self) -> float:
        """The largest step between neighboring vertices."""
        return max(self.spacing)

    @property
    def cell(self) -> float:
        """Edge length of the cells, which must be cubes.

        Raises:
            InputError: if they are not.
        """
        if min(self.spacing) != max(self.spacing):
            raise InputError(f"the cells must be cubes, but their sides are {self.spacing}.")
        return self.spacing[0]

    def positions(self, index: Tensor) -> Tensor:
        """Positions (N, 3), float64, of vertices given by their flat index (N,) in C order."""
        layer, row = self.shape[1] * self.shape[2], self.shape[2]
        vertices = (index // layer, index % layer // row, index % row)
        along = zip(vertices, self.spacing, self.origin, strict=True)
        return torch.stack([vertex.double() * step + start for vertex, step, start in along], dim=-1)

    def refined(self) -> Grid:
        """The grid of half the step on the same box."""
        x, y, z = self.shape
        dx, dy, dz = self.spacing
        return Grid((2 * x - 1, 2 * y - 1, 2 * z - 1), (dx / 2, dy / 2, dz / 2), self.origin)

    def coarsened(self) -> Grid:
        """The grid of twice the step on the same box; along each axis the number of cells must be even."""
        x, y, z = self.shape
        dx, dy, dz = self.spacing
        return Grid((x // 2 + 1, y // 2 + 1, z // 2 + 1), (2 * dx, 2 * dy, 2 * dz), self.origin)

    def contains(self, points: Tensor, margin_cells: float = 0.0) -> bool:
        """Whether all points (N, 3) lie in the grid's box, farther than `margin_cells` steps from its border."""
        steps = (points.detach() - points.new_tensor(self.origin)) / points.new_tensor(self.spacing)
        last = steps.new_tensor(self.shape) - 1 - margin_cells
        return bool(((steps > margin_cells) & (steps < last)).all())


def make_grid(
    points: Tensor,
    spacing: float,
    cells_per_spacing: float = 2.0,
    maximum_vertices: int = 192**3,
    minimum_length: int = 64,
    margin: float = 0.12,
    margin_cells: int = 8,
) -> Grid:
    """A padded grid of cubes around samples, whose cell follows from the sample spacing.

    Args:
        points: (N, 3) sample positions.
        spacing: typical distance between neighboring samples, √(area / N).
        cells_per_spacing: cells that one spacing should span.
        maximum_vertices: the cell grows until the grid has at most this many vertices.
        minimum_length: the longest axis has about this many vertices at least.
        margin: padding on each side as a share of the longest side (Fourier space is periodic).
        margin_cells: padding on each side in cells, at least.

    Raises:
        InputError: if the points have no extent, are not finite, or the spacing is not positive.
    """
    if len(points) == 0 or not spacing > 0:
        raise InputError(f"a grid around {len(points)} points needs a positive spacing, not {spacing:g}.")
    low, high = points.detach().amin(0), points.detach().amax(0)
    extent = (high - low).double()
    longest = float(extent.max())
    if not math.isfinite(longest) or longest <= 0.0:
        raise InputError("the points are all in one place or not finite, so no grid can be laid around them.")
    cell = min(spacing / cells_per_spacing, longest / (minimum_length * 0.7))
    cell = max(cell, longest / maximum_vertices)  # one point so far away that even a row of cells were too many
    while True:
        pad = 2 * max(margin * longest, margin_cells * cell)
        x, y, z = (_fast_length(math.ceil((float(side) + pad) / cell) + 1) for side in extent)
        if x * y * z <= maximum_vertices:
            break
        cell *= 1.02 * max(1.0, (x * y * z / maximum_vertices) ** (1 / 3) * 0.98)
    middle = (low + high).double() / 2
    size = torch.tensor([(n - 1) * cell for n in (x, y, z)], dtype=torch.float64, device=points.device)
    first_x, first_y, first_z = (middle - size / 2).tolist()
    return Grid((x, y, z), (cell, cell, cell), (first_x, first_y, first_z))


def _fast_length(length: int) -> int:
    """The smallest even length, at least `length`, that real Fourier transforms are fast for."""
    fast = max(_FEWEST_VERTICES, length)
    while (fast := next_fast_len(fast, real=True)) % 2:
        fast += 1
    return fast


def occupied_box(inside: Tensor) -> list[tuple[int, int]]:
    """First and last + 1 of the layers along each axis that hold a voxel of a solid (X, Y, Z), which must have one."""
    rows = inside.any(dim=2)
    box = []
    for has_voxel in (rows.any(dim=1), rows.any(dim=0), inside.any(dim=0).any(dim=0)):
        layers = has_voxel.nonzero()[:, 0]
        box.append((int(layers[0]), int(layers[-1]) + 1))
    return box
