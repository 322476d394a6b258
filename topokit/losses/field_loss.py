"""What the losses on fields have in common: reading the source, and reducing over the batch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from torch import Tensor, nn

from topokit.core.blocks.whole import count_solid
from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.field import Field
from topokit.core.grid.grid import Grid
from topokit.core.homotopy.nearest_solid import Betti
from topokit.losses.checks import check_choice
from topokit.losses.source import FieldSource, Source
from topokit.shape import Shape

Reduction = Literal["mean", "sum", "none"]


@dataclass(frozen=True, eq=False)
class CountedSolid:
    """The exact topology of the solid {values > 0} on a grid.

    Attributes:
        values: (X, Y, Z), level subtracted, without a graph.
        connectivity: 6 or 26, that of the solid.
    """

    values: Tensor
    connectivity: int

    @classmethod
    def of(cls, field: Field) -> CountedSolid:
        """The solid of a field, as it is now."""
        return cls(field.detached(), field.connectivity)

    @cached_property
    def betti(self) -> Betti:
        """Components, tunnels and cavities of the solid."""
        components, tunnels, cavities = betti_numbers(self.values, 0.0, self.connectivity).tolist()
        return components, tunnels, cavities

    @cached_property
    def by_component(self) -> tuple[Betti, ...]:
        """The same for each of its components, the largest component first."""
        x, y, z = self.values.shape
        counted = count_solid(self.values, lambda part: part > 0, self.connectivity, Grid((x, y, z)))
        return tuple((components, tunnels, cavities) for components, tunnels, cavities in counted.solid_betti.tolist())

    @property
    def euler(self) -> int:
        """χ of the solid's surface."""
        components, tunnels, cavities = self.betti
        return 2 * (components - tunnels + cavities)


class FieldLoss(nn.Module, ABC):
    """Base class of the losses on fields. A subclass defines `forward`, and `is_met` for `TopologyMonitor`.

    Attributes:
        source: finds the fields in what the loss is called with.
        reduction: "mean", "sum" or "none" over the batch.
    """

    def __init__(
        self, level: float, connectivity: int, resolution: int, reduction: Reduction, is_log_odds: bool = False
    ) -> None:
        super().__init__()
        check_choice("reduction", reduction, ("mean", "sum", "none"))
        self.source = FieldSource(level, connectivity, resolution, is_log_odds)
        self.reduction: Reduction = reduction

    @abstractmethod
    def is_met(self, solid: CountedSolid) -> bool:
        """Whether a solid has the topology that the loss asks for; False always if it asks for none."""

    def reduce(self, losses: Tensor) -> Tensor:
        """The losses of a batch, reduced as asked for."""
        if self.reduction == "none":
            return losses
        return losses.mean() if self.reduction == "mean" else losses.sum()


def batch_shape(source: Source) -> tuple[int, ...]:
    """Shape of the batch: the leading axes of a plain field or of the samples, () for anything else."""
    if isinstance(source, Tensor):
        return tuple(source.shape[:-3])
    has_samples = isinstance(source, Shape) and source.field is None
    return tuple(source.samples.points.shape[:-2]) if has_samples else ()
