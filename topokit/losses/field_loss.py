"""What the losses on fields have in common: reading the source, and reducing over the batch."""

from __future__ import annotations

from typing import Literal

from torch import Tensor, nn

from topokit.losses.checks import check_choice
from topokit.losses.source import FieldSource, Source

Reduction = Literal["mean", "sum", "none"]


class FieldLoss(nn.Module):
    """Base class of the losses on fields.

    Attributes:
        source: finds the fields in what the loss is called with.
        reduction: "mean", "sum" or "none" over the batch.
    """

    def __init__(self, level: float, connectivity: int, resolution: int, reduction: Reduction) -> None:
        super().__init__()
        check_choice("reduction", reduction, ("mean", "sum", "none"))
        self.source = FieldSource(level, connectivity, resolution)
        self.reduction: Reduction = reduction

    def reduce(self, losses: Tensor) -> Tensor:
        """The losses of a batch, reduced as asked for."""
        if self.reduction == "none":
            return losses
        return losses.mean() if self.reduction == "mean" else losses.sum()


def batch_shape(source: Source) -> tuple[int, ...]:
    """Shape of the batch: the leading axes of a plain field or of the samples, () for a shape with a field."""
    if isinstance(source, Tensor):
        return tuple(source.shape[:-3])
    return () if source.field is not None else tuple(source.samples.points.shape[:-2])
