"""A loss on normals and points by their winding number: 0 or 1 off the surface, and normals along its gradient."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from topokit.core.grid.euler import at_least_single
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.core.linalg import normalize
from topokit.core.local.curvature import at_neighbors
from topokit.core.local.frames import normals_from_neighbors
from topokit.core.neighbors import nearest_neighbors
from topokit.core.precision import full_precision
from topokit.errors import InputError
from topokit.losses.checks import check_count, check_finite

_NEIGHBORS = 12  # for planes, and for areas π r² / k
_MARGIN_CELLS = 4  # around the points
_LEAST_RESOLUTION = 16  # grid points along a side: fewer leave no room for a solid and its margins


class WindingLoss(nn.Module):
    """Supervises normals and points by the winding number w of the dipole layer that they form.

    The sum of three terms, each about 0 for outward normals and about 1 for random ones:

    - the double well 16 w² (1 − w)² at two query points of each sample, one on either side of its plane;
    - the balance (w₊ + w₋ − 1)² of the two: one of them is inside;
    - the alignment 1 − cos of each normal with −∇w, which points outward.

    It takes no integer and no label: it pulls normals to consistent signs, and points to where the layer is thin. The
    planes, and the areas if none are given, follow from the points and are held fixed in the gradient.

    Args:
        balance: weight of the balance.
        alignment: weight of the alignment.
        reach: distance of the query points from their sample, in sample spacings.
        resolution: the most grid points along a side of the field.

    Raises:
        InputError: if an argument has a wrong type or value.

    Reference:
        R. Xu et al., "Globally consistent normal orientation for point clouds by regularizing the winding-number
        field", TOG 42(4), 2023, doi:10.1145/3592129 (double well and balance, there at Voronoi vertices).
        S. Lin, Z. Shi, Y. Liu, "Fast and globally consistent normal orientation based on the winding number normal
        consistency", TOG 43(6), 2024, doi:10.1145/3687895 (alignment).

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import sphere_samples
        >>> sphere = sphere_samples(500)
        >>> loss = tk.losses.WindingLoss()
        >>> [bool(loss(sphere.points, normals) < 0.5) for normals in (sphere.normals, -sphere.normals)]
        [True, False]
    """

    def __init__(
        self, *, balance: float = 1.0, alignment: float = 1.0, reach: float = 2.0, resolution: int = 64
    ) -> None:
        super().__init__()
        for name, value in (("balance", balance), ("alignment", alignment), ("reach", reach)):
            check_finite(name, value)
        check_count("resolution", resolution, _LEAST_RESOLUTION)
        self.balance, self.alignment, self.reach, self.resolution = balance, alignment, reach, resolution

    @full_precision
    def forward(
        self, points: Tensor, normals: Tensor, areas: Tensor | None = None, *, smoothing: float = 1.0
    ) -> Tensor:
        """The loss.

        Args:
            points: (N, 3), in general position. Half precisions are computed in float32.
            normals: (N, 3), of any positive length; their direction alone counts.
            areas: (N,), surface area that each sample stands for; from the neighbors' distances if None.
            smoothing: standard deviation of the field's smoothing, in sample spacings. From random normals start at
                about 4 and come down to 1: what is smooth is settled first.

        Returns:
            0-d tensor, differentiable in points, normals and areas.

        Raises:
            InputError: if the shapes do not fit, the smoothing is not positive, or there are too few points.
        """
        if not 0 < smoothing < math.inf:
            raise InputError(f"smoothing must be a positive number, not {smoothing!r}.")
        if points.ndim != 2 or points.shape[-1] != 3 or normals.shape != points.shape:
            raise InputError(
                f"points and normals must both be (N, 3), got {tuple(points.shape)} and {tuple(normals.shape)}."
            )
        points, normals = at_least_single(points), at_least_single(normals)
        planes, own_areas = _planes_and_areas(points.detach())
        spacing = float(own_areas.mean().sqrt())
        areas = own_areas if areas is None else at_least_single(areas)
        grid = make_grid(points, spacing, 1.0, self.resolution**3, self.resolution // 2, margin_cells=_MARGIN_CELLS)
        directions = normalize(normals)
        field = winding_field(points, directions, areas, grid, sigma=smoothing * spacing / grid.cell)
        outside = field.values[0, 0, 0]  # the corner of a padded grid
        above, below = (field.sample(points + side * self.reach * spacing * planes) - outside for side in (1, -1))
        both = torch.stack((above, below))
        well = 16 * (both * (1 - both)).square()
        balance = (above + below - 1).square()
        alignment = 1 + (directions * normalize(field.gradient(points))).sum(-1)
        return well.mean() + self.balance * balance.mean() + self.alignment * alignment.mean()


def winding_loss(
    points: Tensor,
    normals: Tensor,
    areas: Tensor | None = None,
    *,
    balance: float = 1.0,
    alignment: float = 1.0,
    reach: float = 2.0,
    resolution: int = 64,
) -> Tensor:
    """Functional form of `WindingLoss`.

    Args:
        points: see `WindingLoss.forward`.
        normals: see `WindingLoss.forward`.
        areas: see `WindingLoss.forward`.
        balance: see `WindingLoss`.
        alignment: see `WindingLoss`.
        reach: see `WindingLoss`.
        resolution: see `WindingLoss`.

    Returns:
        0-d tensor.

    Raises:
        InputError: if an argument has a wrong type or value.
    """
    loss = WindingLoss(balance=balance, alignment=alignment, reach=reach, resolution=resolution)
    return loss(points, normals, areas)


@torch.no_grad()
def _planes_and_areas(points: Tensor) -> tuple[Tensor, Tensor]:
    """Normals (N, 3) of arbitrary sign and areas (N,) of the neighborhoods."""
    neighbors = nearest_neighbors(points, _NEIGHBORS)
    offsets = at_neighbors(points, neighbors, torch.arange(len(points), device=points.device)) - points[:, None]
    areas = torch.pi * offsets[:, -1].square().sum(-1) / _NEIGHBORS
    return normals_from_neighbors(offsets), areas
