"""The Euler loss, (χ_τ − target)²: the squared error of the smoothed Euler characteristic of a field."""

from __future__ import annotations

import torch
from torch import Tensor

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, smoothed_euler
from topokit.losses.checks import check_finite, check_tau
from topokit.losses.field_loss import CountedSolid, FieldLoss, Reduction, batch_shape
from topokit.losses.source import Source, plain_field


class EulerLoss(FieldLoss):
    """Squared difference between the smoothed Euler characteristic χ_τ and a target.

    Smooth and cheap; with `tau` given, a plain field is handled in one piece and `torch.compile(fullgraph=True)` works.
    Every critical point within about τ of the level gets a gradient, including those of noise, and χ alone does not
    tell a ball from a torus with a stray blob. To change the topology of noisy data use `TopologyLoss`, which asks for
    Betti numbers; docs/topology-loss.md compares the two.

    Args:
        target: wanted Euler characteristic of the surface, summed over its components (2 for a ball, 0 for a torus).
        level: of a plain field; {field > level} is the solid. A shape has its own.
        connectivity: 6 or 26, that of the solid, of a plain field and of samples; a shape with a field has its own.
        resolution: for shapes without a field: the most grid points along a side of the winding-number field.
        reduction: "mean", "sum" or "none" over the batch.

    Raises:
        InputError: if an argument has a wrong type or value.

    Example:
        >>> import topokit as tk, torch
        >>> noise = torch.randn(2, 8, 8, 8, generator=torch.Generator().manual_seed(0))
        >>> tk.EulerLoss(2.0, reduction="none")(noise, tau=0.1).shape
        torch.Size([2])
    """

    def __init__(
        self,
        target: float,
        *,
        level: float = 0.0,
        connectivity: int = DEFAULT_CONNECTIVITY,
        resolution: int = 64,
        reduction: Reduction = "mean",
    ) -> None:
        check_finite("target", target)
        super().__init__(level, connectivity, resolution, reduction)
        self.target = float(target)

    def forward(self, source: Source, tau: float | None = None) -> Tensor:
        """The loss.

        Args:
            source: (..., X, Y, Z) floating-point field, positive inside, on any device; or a shape with a field
                (from_sdf, from_occupancy, from_voxels), only whose critical grid points are evaluated with a
                graph; or a shape with oriented samples (points, splats, batches of them), whose
                winding-number field is used.
            tau: scale of the levels over which χ is averaged, in units of the field. By default half the field's
                typical change over one cell at its zero crossings.

        Returns:
            0-d tensor, or (...) with reduction "none"; at least single precision. Differentiable at fixed critical
            points. Finite for infinite and constant fields; NaN gives NaN. Slopes go with 1 / tau: a float16 field
            cannot hold them when tau is below about 1e-3.

        Raises:
            InputError: for another kind of source, or a tau that is not positive.
        """
        check_tau(tau)
        if isinstance(source, Tensor) and tau is not None:
            chi = smoothed_euler(plain_field(source), tau, self.source.level, self.source.connectivity)
        else:
            per_item = [field.smoothed_euler(tau) for field, _ in self.source(source)]
            chi = torch.stack(per_item).reshape(batch_shape(source))
        return self.reduce((chi - self.target).square())

    def is_met(self, solid: CountedSolid) -> bool:
        """Whether the surface of a solid has the Euler characteristic `target`."""
        return solid.euler == self.target


def euler_loss(
    source: Source,
    target: float,
    tau: float | None = None,
    *,
    level: float = 0.0,
    connectivity: int = DEFAULT_CONNECTIVITY,
    resolution: int = 64,
    reduction: Reduction = "mean",
) -> Tensor:
    """Functional form of `EulerLoss`.

    Args:
        source: field, batch of fields or shape; see `EulerLoss.forward`.
        target: wanted Euler characteristic of the surface.
        tau: scale of the levels; see `EulerLoss.forward`.
        level: see `EulerLoss`.
        connectivity: see `EulerLoss`.
        resolution: see `EulerLoss`.
        reduction: see `EulerLoss`.

    Returns:
        0-d tensor, or (...) with reduction "none".

    Raises:
        InputError: if an argument has a wrong type or value.

    Example:
        >>> import topokit as tk, torch
        >>> tk.euler_loss(torch.ones(4, 4, 4), target=0.0, tau=0.1)  # a solid block has χ = 2
        tensor(3.9996)
    """
    loss = EulerLoss(target, level=level, connectivity=connectivity, resolution=resolution, reduction=reduction)
    return loss(source, tau)
