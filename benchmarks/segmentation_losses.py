"""Topology terms for segmentation, added to a Dice loss with cross-entropy: ours and those of others.

Each has the weight that its authors use. Betti matching also has a smaller one and ours a larger one, which shows what
the weight trades. Terms of others come from MONAI and topolosses; Skeleton Recall, which is part of a trainer of
nnU-Net, is defined here anew.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import NamedTuple

import numpy as np
import torch
from skimage.morphology import dilation, skeletonize
from torch import Tensor
from torch.nn.functional import one_hot

from topokit.losses import SegmentationTopologyLoss

Term = Callable[[Tensor, Tensor], Tensor]
"""Of logits (B, 2, …) and true masks (B, 1, …) int64, a 0-d tensor."""


class Competitor(NamedTuple):
    """A term, and how it is meant to be used.

    Attributes:
        make: the term, weight 1.
        weight: beside Dice and cross-entropy, each of weight 1.
        dims: of the images that it takes.
        module: that it needs.
    """

    make: Callable[[], Term]
    weight: float
    dims: tuple[int, ...]
    module: str

    @property
    def is_here(self) -> bool:
        """Whether its module can be imported, with what that needs itself."""
        return _can_be_imported(self.module)

    def takes(self, dims: int) -> bool:
        """Whether it can be used here, for images of so many dimensions."""
        return dims in self.dims and self.is_here


@cache  # a second try at a package that fails halfway ends otherwise
def _can_be_imported(module: str) -> bool:
    try:
        import_module(module)
    except ImportError:
        return False
    return True


def _none() -> Term:
    return lambda logits, mask: 0.0 * logits.sum()


def _cl_dice() -> Term:
    from monai.losses import SoftclDiceLoss

    term = SoftclDiceLoss(iter_=3, include_background=False, softmax=True)
    return lambda logits, mask: term(logits, two_channels(mask))


def _skeleton_recall() -> Term:
    return skeleton_recall


def _betti_matching() -> Term:
    from topolosses.losses import BettiMatchingLoss

    term = BettiMatchingLoss(softmax=True, use_base_loss=False, alpha=1)
    return lambda logits, mask: term(logits, two_channels(mask))


def _topograph() -> Term:
    from topolosses.losses import TopographLoss

    term = TopographLoss(softmax=True, use_base_loss=False, alpha=1)
    return lambda logits, mask: term(logits, two_channels(mask))


def _ours() -> Term:
    return SegmentationTopologyLoss(include_background=False, softmax=True)


COMPETITORS = {
    "Dice": Competitor(_none, 0.0, (2, 3), "torch"),
    # (1 − α) Dice + α clDice with α = 0.5: S. Shit et al., arXiv:2003.07311.
    "clDice": Competitor(_cl_dice, 1.0, (2, 3), "monai.losses"),
    # The trainer of nnU-Net: Y. Kirchhoff et al., arXiv:2404.03010.
    "Skeleton Recall": Competitor(_skeleton_recall, 1.0, (2, 3), "skimage.morphology"),
    # Configurations of N. Stucki et al., arXiv:2211.15272, and the default of topolosses.
    "Betti matching": Competitor(_betti_matching, 0.5, (2, 3), "topolosses.losses"),
    "Betti matching, weight 0.05": Competitor(_betti_matching, 0.05, (2, 3), "topolosses.losses"),
    # The default of topolosses, by the authors of L. Lux et al., arXiv:2411.03228.
    "Topograph": Competitor(_topograph, 0.1, (2,), "topolosses.losses"),
    "topokit": Competitor(_ours, 1.0, (2, 3), "topokit.losses"),
    "topokit, weight 5": Competitor(_ours, 5.0, (2, 3), "topokit.losses"),
}


def skeleton_recall(logits: Tensor, mask: Tensor) -> Tensor:
    """Share of the target's skeleton, two voxels thicker, that is not predicted.

    Reference:
        Y. Kirchhoff et al., "Skeleton Recall Loss for connectivity conserving and resource efficient segmentation of
        thin tubular structures", ECCV 2024, arXiv:2404.03010. Sums run over each image by itself.
    """
    tubes = [np.asarray(skeletonize(one) > 0) for one in mask[:, 0].bool().cpu().numpy()]
    tube = torch.from_numpy(np.stack([dilation(dilation(one)) for one in tubes])).to(mask.device) & (mask[:, 0] > 0)
    axes = tuple(range(1, tube.ndim))
    found = (torch.softmax(logits, 1)[:, 1] * tube).sum(axes)
    return 1 - ((found + 1e-5) / (tube.sum(axes) + 1e-5)).mean()


def two_channels(mask: Tensor) -> Tensor:
    """Background and mask (B, 2, …) as numbers."""
    return one_hot(mask[:, 0].long(), 2).movedim(-1, 1).float()
