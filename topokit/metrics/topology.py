"""Topology of predicted segmentations as a metric that is updated batch by batch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.errors import InputError, requiring
from topokit.metrics.counter import Batch, FeatureCounter

if TYPE_CHECKING:
    import torchmetrics
    from monai.metrics.metric import CumulativeIterationMetric


class TopologyMetric:
    """Betti errors and matched, missing and spurious features of segmentations, averaged over all items seen.

    It has the methods of a metric of torchmetrics (`update`, `compute`, `reset`, `forward`, `to`), and those of a
    cumulative metric of MONAI (a call with `y_pred` and `y`, `aggregate`, `reset`), and depends on neither. What asks
    for their classes, such as a `MetricCollection`, takes `as_torchmetrics()` or `as_monai()`. Where
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
        self.counter = FeatureCounter(n_classes, level, connectivity, ignore_index, dimensions)
        self._device = torch.device("cpu")
        self.reset()

    def reset(self) -> None:
        """Forget all items."""
        self._sums = torch.zeros(self.counter.shape, dtype=torch.float64, device=self._device)
        self._n_items = torch.zeros((), dtype=torch.float64, device=self._device)

    def update(self, preds: Batch, target: Batch) -> None:
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
        self._add(preds, target)

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
        return self.counter.means(sums, n_items)

    aggregate = compute

    def forward(self, preds: Batch, target: Batch) -> dict[str, Tensor]:
        """Count a batch and return its own means."""
        return self.counter.means(*self._add(preds, target))

    def _add(self, preds: Batch, target: Batch) -> tuple[Tensor, Tensor]:
        """Count a batch; the sums over its items, and their number."""
        counts = self.counter.counted(preds, target).to(self._sums.device)
        sums, n_items = counts.sum(0), torch.tensor(len(counts))
        self._sums += sums
        self._n_items += len(counts)
        return sums, n_items

    def to(self, device: torch.device | str) -> TopologyMetric:
        """The metric with its sums on a device, as `torch.distributed` may want them; solids are counted on the CPU."""
        self._device = torch.device(device)
        self._sums, self._n_items = self._sums.to(device), self._n_items.to(device)
        return self

    def __call__(
        self,
        preds: Batch | None = None,
        target: Batch | None = None,
        *,
        y_pred: Batch | None = None,
        y: Batch | None = None,
    ) -> dict[str, Tensor]:
        """As `forward`; MONAI gives `y_pred` and `y`."""
        preds, target = (preds if y_pred is None else y_pred), (target if y is None else y)
        if preds is None or target is None:
            raise InputError("a prediction and its target are needed.")
        return self.forward(preds, target)

    def as_torchmetrics(self) -> torchmetrics.Metric:
        """A metric of torchmetrics with these options, for a `MetricCollection`, Lightning or a checkpoint.

        Raises:
            MissingDependencyError: if torchmetrics is not installed.
        """
        with requiring("as_torchmetrics needs torchmetrics: pip install torchmetrics."):
            from topokit.metrics.with_torchmetrics import TorchTopologyMetric
        return TorchTopologyMetric(self.counter)

    def as_monai(self) -> CumulativeIterationMetric:
        """A cumulative metric of MONAI with these options, for its handlers and evaluators.

        Raises:
            MissingDependencyError: if MONAI is not installed.
        """
        with requiring("as_monai needs MONAI: pip install monai."):
            from topokit.metrics.with_monai import MonaiTopologyMetric
        return MonaiTopologyMetric(self.counter)
