"""Topology of predicted segmentations as a metric that is updated batch by batch."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import torch
from torch import Tensor

from topokit.core.comparison.pair import SolidPair
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, check_connectivity
from topokit.errors import InputError

_KINDS = ("betti_error", "betti_matching_error", "missing", "spurious", "matched")
_ROWS = ("betti_a", "betti_b", "matched", "betti_error")  # of the sums, each (parts, tunnels, cavities)


class TopologyMetric:
    """Betti errors and matched, missing and spurious features of segmentations, averaged over all items seen.

    It has the methods of a metric of torchmetrics (`update`, `compute`, `reset`, `forward`, `to`), and those of a
    cumulative metric of MONAI (a call with `y_pred` and `y`, `aggregate`, `reset`), and depends on neither. Where
    `torch.distributed` runs, `compute` sums over all processes. Nothing is differentiable; counting runs on the CPU.

    Args:
        n_classes: None for masks; else the number of classes with the background, class 0, which is not scored.
        level: floating-point predictions of masks are inside above it: 0.5 for probabilities, 0 for logits.
        connectivity: 6 or 26, of every class by itself; in images 6 means through edges (4), 26 also corners (8).
        ignore_index: value of the target at which both count as background.
        dimensions: 3 for volumes, 2 for images.

    Raises:
        InputError: if the connectivity, the number of classes or the dimensions make no sense.

    Example:
        >>> import torch
        >>> from topokit.metrics import TopologyMetric
        >>> target = torch.ones(1, 1, 5, 5, 3)
        >>> target[:, :, 2, 2] = 0
        >>> metric = TopologyMetric()
        >>> metric.update(torch.ones(1, 1, 5, 5, 3), target)
        >>> metric.compute()["betti_error1"].item(), metric.compute()["missing1"].item()
        (1.0, 1.0)
    """

    full_state_update = False
    higher_is_better = False
    is_differentiable = False

    def __init__(
        self,
        n_classes: int | None = None,
        *,
        level: float = 0.5,
        connectivity: int = DEFAULT_CONNECTIVITY,
        ignore_index: int | None = None,
        dimensions: int = 3,
    ) -> None:
        if n_classes is not None and n_classes < 2:
            raise InputError(
                f"n_classes is {n_classes}; None for masks, or at least 2, with the background, was expected."
            )
        if dimensions not in (2, 3):
            raise InputError(f"dimensions must be 2 or 3, got {dimensions}.")
        self.n_classes, self.level, self.ignore_index = n_classes, level, ignore_index
        self.connectivity, self.dimensions = check_connectivity(connectivity), dimensions
        self.reset()

    def reset(self) -> None:
        """Forget all items."""
        self._sums = torch.zeros((self.n_classes or 2) - 1, len(_ROWS), 3, dtype=torch.float64)
        self._n_items = torch.zeros((), dtype=torch.float64)

    def update(self, preds: Tensor | Sequence[Tensor], target: Tensor | Sequence[Tensor]) -> None:
        """Count the items of a batch.

        Args:
            preds: of masks (B, X, Y, Z) or (B, 1, X, Y, Z): booleans, integers (inside above 0), or floating-point
                numbers (inside above `level`). Of classes (B, C, X, Y, Z), the largest of which counts, or their
                numbers (B, X, Y, Z) or (B, 1, X, Y, Z). Images lack the last axis. A list has items (C, X, Y, Z).
            target: likewise; floating-point masks are inside above 0.5.

        Raises:
            InputError: if shapes do not fit.

        Warns:
            UserWarning: if predictions of masks look like logits, and `level` is one of probabilities.
        """
        if self.n_classes is None and 0 < self.level < 1 and any(map(_are_logits, preds)):
            warnings.warn(
                f"predictions below 0 or above 1 are no probabilities, and count as inside above {self.level}: for "
                "logits pass TopologyMetric(level=0.0).",
                stacklevel=2,
            )
        items = list(zip(*(self._classes(*one) for one in ((preds, self.level), (target, 0.5))), strict=True))
        for predicted, true in items:
            if predicted.shape != true.shape:
                raise InputError(f"the prediction has shape {tuple(predicted.shape)}, its target {tuple(true.shape)}.")
            seen = torch.ones_like(true, dtype=torch.bool) if self.ignore_index is None else true != self.ignore_index
            for number in range(1, self.n_classes or 2):
                first, second = (((one == number) & seen).numpy() for one in (predicted, true))
                found = SolidPair(first, second, self.connectivity).numbers
                a, b, both = (torch.tensor(numbers) for numbers in (found.first, found.second, found.matched))
                self._sums[number - 1] += torch.stack((a, b, both, (a - b).abs()))
        self._n_items += len(items)

    def compute(self) -> dict[str, Tensor]:
        """Means over all items: "betti_error0" … "betti_error2", likewise "betti_matching_error", "missing", and so on.

        0 is about parts, 1 about tunnels, 2 about cavities; the others are "spurious" and "matched". Values are 0-d
        tensors for masks, else (n_classes − 1,).

        Raises:
            InputError: if there were no items.
        """
        sums, n_items = self._sums.clone(), self._n_items.clone()
        if torch.distributed.is_available() and torch.distributed.is_initialized():
            for state in (sums, n_items):
                torch.distributed.all_reduce(state)
        if n_items == 0:
            raise InputError("nothing was counted yet: call update(preds, target) first.")
        return self._means(sums / n_items)

    aggregate = compute

    def forward(self, preds: Tensor | Sequence[Tensor], target: Tensor | Sequence[Tensor]) -> dict[str, Tensor]:
        """Count a batch and return its own means."""
        before = self._sums, self._n_items
        self.reset()
        self.update(preds, target)
        found = self._means(self._sums / self._n_items)
        self._sums, self._n_items = self._sums + before[0], self._n_items + before[1]
        return found

    def to(self, device: torch.device | str) -> TopologyMetric:
        """The metric with its sums on a device, as `torch.distributed` may want them; solids are counted on the CPU."""
        self._sums, self._n_items = self._sums.to(device), self._n_items.to(device)
        return self

    def __call__(
        self,
        preds: Tensor | Sequence[Tensor] | None = None,
        target: Tensor | Sequence[Tensor] | None = None,
        *,
        y_pred: Tensor | Sequence[Tensor] | None = None,
        y: Tensor | Sequence[Tensor] | None = None,
    ) -> dict[str, Tensor]:
        """As `forward`; MONAI gives `y_pred` and `y`."""
        preds, target = (preds if y_pred is None else y_pred), (target if y is None else y)
        if preds is None or target is None:
            raise InputError("a prediction and its target are needed.")
        return self.forward(preds, target)

    def _means(self, means: Tensor) -> dict[str, Tensor]:
        found = dict(zip(_ROWS, means.unbind(1), strict=True))
        found["missing"] = found["betti_b"] - found["matched"]
        found["spurious"] = found["betti_a"] - found["matched"]
        found["betti_matching_error"] = found["missing"] + found["spurious"]
        named = {f"{kind}{k}": found[kind][:, k].float() for kind in _KINDS for k in range(3)}
        return {name: values[0] if self.n_classes is None else values for name, values in named.items()}

    def _classes(self, values: Tensor | Sequence[Tensor], level: float) -> list[Tensor]:
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
