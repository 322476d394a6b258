"""The topology loss with the signature of segmentation losses: predictions and masks, both with channels."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from topokit.core.grid.euler import at_least_single
from topokit.errors import InputError
from topokit.losses.field_loss import Reduction
from topokit.losses.topology import TopologyLoss

# Share of the slopes of `TopologyLoss` for log-odds: 10 at a decisive voxel, not 50. One field has to change there;
# here a network has to do well on other images. Slopes of 10, 50 and 150 cost 0.00, 0.01 and 0.02 of Dice on trees in
# the plane (benchmarks/segmentation.py, one, two and one of seeds 5 and 6; docs/segmentation-measured.md has 0 to 4).
_SHARE = 0.2
_SMALLEST_PROBABILITY = 1e-6  # log-odds of smaller ones, and of 1 less this, are not told apart: single precision


class SegmentationTopologyLoss(nn.Module):
    """Asks each class of a prediction for the features of its mask, each in its place.

    The arguments are those of MONAI's losses. Beside Dice and a mean cross-entropy, each of weight 1, it has weight 1.
    In docs/segmentation-measured.md this costs 0.001 to 0.014 of Dice; with weight 5 there are fewer errors of topology
    and there is less Dice. Add it when the network finds most of the mask.

    Args:
        include_background: whether channel 0 counts, too.
        sigmoid: the input is log-odds of each channel; a channel's solid is where they are positive.
        softmax: the input is logits of exclusive classes; a class is where it has the largest one.
        reduction: "mean", "sum" or "none", which gives (B, C).

    Raises:
        InputError: if both sigmoid and softmax are asked for, or the reduction is unknown.

    Example:
        >>> import topokit as tk, torch
        >>> mask = torch.zeros(1, 1, 16, 16, dtype=torch.long)
        >>> mask[..., 2:14, 7:9] = 1  # a vessel
        >>> logits = 4.0 * torch.cat((1 - mask, mask), dim=1)
        >>> loss = tk.losses.SegmentationTopologyLoss(include_background=False, softmax=True)
        >>> broken = logits.clone()
        >>> broken[:, 1, 8] = -4.0
        >>> bool(loss(logits, mask) == 0), bool(loss(broken, mask) > 0)
        (True, True)
    """

    def __init__(
        self,
        include_background: bool = True,
        sigmoid: bool = False,
        softmax: bool = False,
        reduction: Reduction = "mean",
    ) -> None:
        super().__init__()
        if sigmoid and softmax:
            raise InputError("choose sigmoid (independent channels) or softmax (exclusive classes), not both.")
        self.include_background, self.sigmoid, self.softmax = include_background, sigmoid, softmax
        self.loss = TopologyLoss(logits=True, reduction=reduction)

    def forward(self, input: Tensor, target: Tensor) -> Tensor:
        """The loss.

        Args:
            input: (B, C, X, Y, Z) or (B, C, X, Y): log-odds, logits, or probabilities if neither was said. Those of 0
                and 1, to six digits, have no slope.
            target: class numbers (B, 1, ...), or one mask for each channel (B, C, ...).

        Returns:
            0-d tensor, or (B, C) with reduction "none"; see `TopologyLoss.forward`.

        Raises:
            InputError: if the shapes do not fit, or what should be probabilities are none.
        """
        n_classes = input.shape[1] if input.ndim in (4, 5) else 0
        if not n_classes or target.shape not in (input.shape, (len(input), 1, *input.shape[2:])):
            raise InputError(
                "expected an input (B, C, X, Y, Z) or (B, C, X, Y), and a target like it or with one channel; got "
                f"{tuple(input.shape)} and {tuple(target.shape)}."
            )
        masks = target > 0.5
        if n_classes > 1 and target.shape[1] == 1:
            classes = torch.arange(n_classes, device=target.device)
            masks = target == classes.reshape(-1, *[1] * (input.ndim - 2))
        first = 0 if self.include_background or n_classes == 1 else 1
        fields, masks = self._fields(input)[:, first:], masks[:, first:]
        if input.ndim == 4:
            fields, masks = fields[..., None], masks[..., None]
        value: Tensor = _SHARE * self.loss(fields, target=masks)
        return value

    def _fields(self, values: Tensor) -> Tensor:
        """Log-odds of each channel's class."""
        if self.sigmoid:
            return values
        if not self.softmax:
            if bool(((values < 0) | (values > 1)).any()):
                raise InputError(
                    "expected probabilities, and there are values below 0 or above 1; for log-odds pass sigmoid=True, "
                    "for logits of exclusive classes softmax=True."
                )
            return at_least_single(values).logit(_SMALLEST_PROBABILITY)
        best = values.topk(min(2, values.shape[1]), dim=1).values
        return values - torch.where(values == best[:, :1], best[:, -1:], best[:, :1])
