"""The topology metric as a class of torchmetrics; importing this needs the package."""

from __future__ import annotations

import torch
from torch import Tensor
from torchmetrics import Metric

from topokit.metrics.counter import Batch, FeatureCounter


class TorchTopologyMetric(Metric):
    """Means over all items seen, as `TopologyMetric`; torchmetrics keeps, moves, saves and reduces the sums."""

    full_state_update = False
    higher_is_better = False
    is_differentiable = False
    sums: Tensor
    n_items: Tensor

    def __init__(self, counter: FeatureCounter) -> None:
        """Args: counter with the options."""
        super().__init__()
        self.counter = counter
        self.add_state("options", counter.options, dist_reduce_fx="max")  # a collection shares the sums of equal states
        self.add_state("sums", torch.zeros(counter.shape, dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("n_items", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")

    def update(self, preds: Batch, target: Batch) -> None:
        """As `TopologyMetric.update`."""
        counts = self.counter.counted(preds, target).to(self.sums.device)
        self.sums += counts.sum(0)
        self.n_items += len(counts)

    def compute(self) -> dict[str, Tensor]:
        """As `TopologyMetric.compute`."""
        return self.counter.means(self.sums, self.n_items)
