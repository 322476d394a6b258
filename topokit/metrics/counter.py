"""How often features of predicted segmentations match, are missing or spurious: counts of single items."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.comparison.pair import SolidPair
from topokit.core.grid.euler import check_connectivity
from topokit.errors import InputError

Batch = Tensor | Sequence[Tensor]

_KINDS = ("betti_error", "betti_matching_error", "missing", "spurious", "matched")
_ROWS = ("betti_a", "betti_b", "matched", "betti_error")  # of what is counted, each (parts, tunnels, cavities)


@dataclass(frozen=True)
class FeatureCounter:
    """Counts features of predictions and targets, which are solids on one grid.

    The attributes are the arguments of `TopologyMetric`.
    """

    n_classes: int | None
    level: float
    connectivity: int
    ignore_index: int | None
    dimensions: int

    def __post_init__(self) -> None:
        if self.n_classes is not None and self.n_classes < 2:
            raise InputError(
                f"n_classes is {self.n_classes}; None for masks, or at least 2, with the background, was expected."
            )
        if self.dimensions not in (2, 3):
            raise InputError(f"dimensions must be 2 or 3, got {self.dimensions}.")
        check_connectivity(self.connectivity)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the counts of one item: classes, Betti numbers of both, matches and Betti errors, dimensions."""
        return (self.n_classes or 2) - 1, len(_ROWS), 3

    @property
    def options(self) -> Tensor:
        """The attributes as numbers, NaN for None."""
        values = (self.n_classes, self.level, self.connectivity, self.ignore_index, self.dimensions)
        return torch.tensor([float("nan") if value is None else float(value) for value in values]).double()

    def counted(self, preds: Batch, target: Batch) -> Tensor:
        """Counts (items, *shape) of the items of a batch, as float64 on the CPU; arguments as for `update`."""
        if self.n_classes is None and 0 < self.level < 1 and any(map(_are_logits, preds)):
            warnings.warn(
                f"predictions below 0 or above 1 are no probabilities, and count as inside above {self.level}: for "
                "logits pass TopologyMetric(level=0.0).",
                stacklevel=3,
            )
        items = list(zip(*(self._classes(*one) for one in ((preds, self.level), (target, 0.5))), strict=True))
        return torch.stack([self._item(*one) for one in items]) if items else torch.zeros(0, *self.shape).double()

    def means(self, sums: Tensor, n_items: Tensor) -> dict[str, Tensor]:
        """The means that `TopologyMetric.compute` returns, from sums (*shape) over items.

        Raises:
            InputError: if there were no items.
        """
        if n_items == 0:
            raise InputError("nothing was counted yet: call update(preds, target) first.")
        found = dict(zip(_ROWS, (sums / n_items).unbind(1), strict=True))
        found["missing"] = found["betti_b"] - found["matched"]
        found["spurious"] = found["betti_a"] - found["matched"]
        found["betti_matching_error"] = found["missing"] + found["spurious"]
        named = {f"{kind}{k}": found[kind][:, k].float() for kind in _KINDS for k in range(3)}
        return {name: values[0] if self.n_classes is None else values for name, values in named.items()}

    def _item(self, predicted: Tensor, true: Tensor) -> Tensor:
        """Counts (shape) of one item, of whose voxels the classes are given."""
        if predicted.shape != true.shape:
            raise InputError(f"the prediction has shape {tuple(predicted.shape)}, its target {tuple(true.shape)}.")
        seen = torch.ones_like(true, dtype=torch.bool) if self.ignore_index is None else true != self.ignore_index
        counts = []
        for number in range(1, self.n_classes or 2):
            first, second = (((one == number) & seen).numpy() for one in (predicted, true))
            found = SolidPair(first, second, self.connectivity).numbers
            a, b, both = (torch.tensor(numbers) for numbers in (found.first, found.second, found.matched))
            counts.append(torch.stack((a, b, both, (a - b).abs())))
        return torch.stack(counts).double()

    def _classes(self, values: Batch, level: float) -> list[Tensor]:
        """The class of every voxel (X, Y, Z), of each item."""
        items = [torch.as_tensor(one).detach().cpu() for one in values]
        return [self._classes_of(one, level) for one in items]

    def _classes_of(self, item: Tensor, level: float) -> Tensor:
        has_channels = item.dim() == self.dimensions + 1
        if has_channels and len(item) == self.n_classes:
            item = item.to(torch.uint8).argmax(0) if item.dtype == torch.bool else item.argmax(0)
        elif has_channels and len(item) == 1:
            item = item[0]
        if item.dim() != self.dimensions:
            wanted = f"(B, {'C, ' if self.n_classes else '1, '}{'X, Y, Z' if self.dimensions == 3 else 'X, Y'})"
            raise InputError(f"a batch {wanted} was expected, got items of shape {tuple(item.shape)}.")
        if self.n_classes is None and item.is_floating_point():
            item = (
                (item > level)
                if self.ignore_index is None
                else torch.where(item == self.ignore_index, item, (item > level).to(item.dtype))
            )
        elif self.n_classes is None and item.dtype != torch.bool and self.ignore_index is None:
            item = item > 0
        return item if self.dimensions == 3 else item[..., None]


def _are_logits(prediction: Tensor) -> bool:
    values = torch.as_tensor(prediction)
    return values.is_floating_point() and bool(((values < 0) | (values > 1)).any())
