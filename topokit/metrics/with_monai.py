"""The topology metric as a class of MONAI; importing this needs the package."""

from __future__ import annotations

from typing import Any

import torch
from monai.metrics.metric import CumulativeIterationMetric
from torch import Tensor

from topokit.errors import InputError
from topokit.metrics.counter import FeatureCounter


class MonaiTopologyMetric(CumulativeIterationMetric):
    """Means over all items seen, as `TopologyMetric`; MONAI keeps the counts of items and gathers them."""

    def __init__(self, counter: FeatureCounter) -> None:
        """Args: counter with the options."""
        super().__init__()
        self.counter = counter

    def aggregate(self) -> dict[str, Tensor]:
        """As `TopologyMetric.compute`."""
        counts = self.get_buffer()
        counts = torch.zeros(0, *self.counter.shape) if counts is None else counts
        return self.counter.means(counts.sum(0), torch.tensor(len(counts)))

    def _compute_tensor(self, y_pred: Tensor, y: Tensor | None = None, **_: Any) -> Tensor:
        if y is None:
            raise InputError("a prediction and its target are needed.")
        return self.counter.counted(y_pred, y)
