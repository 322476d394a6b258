"""`TopologyMetric`: batches of masks, logits, classes and images, and what frameworks call."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.metrics import TopologyMetric

RING = torch.zeros(8, 8, 3)
RING[1:7, 1:7] = 1
RING[3:5, 3:5] = 0
FULL = RING.clone()
FULL[3:5, 3:5] = 1


def test_masks_and_logits_are_averaged_over_batches() -> None:
    metric = TopologyMetric()
    metric.update(torch.stack((RING, FULL))[:, None], torch.stack((RING, RING))[:, None])
    metric.update(FULL[None], FULL[None].bool())
    found = metric.compute()
    assert found["betti_error1"].item() == pytest.approx(1 / 3)
    assert found["missing1"].item() == pytest.approx(1 / 3)
    assert found["matched0"].item() == 1
    logits = TopologyMetric(level=0.0)
    assert logits(10 * RING[None] - 5, RING[None])["betti_matching_error1"] == 0
    metric.reset()
    with pytest.raises(tk.InputError, match="call update"):
        metric.compute()


def test_it_equals_compare() -> None:
    generator = np.random.default_rng(0)
    pairs = [generator.random((2, 9, 8, 7)) > 0.5 for _ in range(3)]
    metric = TopologyMetric(connectivity=26)
    metric.update(torch.tensor(np.stack([one[0] for one in pairs])), torch.tensor(np.stack([one[1] for one in pairs])))
    found, expected = metric.compute(), [tk.compare(*one, connectivity=26) for one in pairs]
    for name in ("betti_error", "betti_matching_error", "missing", "spurious", "matched"):
        for k in range(3):
            assert found[f"{name}{k}"].item() == pytest.approx(np.mean([getattr(one, name)[k] for one in expected]))


def test_classes_one_hot_ignored_and_images() -> None:
    target = torch.zeros(1, 8, 8, 3, dtype=torch.long)
    target[0, :, :4], target[0, :, 5:] = 1, 2
    predicted = target.clone()
    predicted[0, 4, :4] = 0
    one_hot = torch.nn.functional.one_hot(predicted, 3).movedim(-1, 1)
    for preds in (one_hot, one_hot.float(), one_hot.bool(), predicted, predicted[:, None]):
        found = TopologyMetric(n_classes=3)(preds, target)
        assert found["spurious0"].tolist() == [1, 0]
    assert TopologyMetric(n_classes=3, ignore_index=1)(predicted, target)["betti_error0"].tolist() == [0, 0]
    hidden = RING.clone()
    hidden[3:5, 3:5] = -1
    assert TopologyMetric(ignore_index=-1)(FULL[None], hidden[None])["betti_error1"] == 0
    assert TopologyMetric(dimensions=2)(FULL[None, None, :, :, 0], RING[None, None, :, :, 0])["missing1"] == 1


def test_forward_gives_the_batch_and_keeps_the_sum() -> None:
    metric = TopologyMetric().to("cpu")
    assert metric(FULL[None], RING[None])["missing1"] == 1
    assert metric(y_pred=[RING[None]], y=[RING[None]])["missing1"] == 0
    assert metric.aggregate()["missing1"] == 0.5


def test_what_does_not_fit_is_said() -> None:
    with pytest.raises(tk.InputError, match="items of shape"):
        TopologyMetric()(RING, RING)
    with pytest.raises(tk.InputError, match="its target"):
        TopologyMetric()(RING[None], RING[None, :4])
    with pytest.raises(tk.InputError, match="n_classes is 1"):
        TopologyMetric(n_classes=1)
    with pytest.raises(tk.InputError, match="dimensions"):
        TopologyMetric(dimensions=4)


def test_logits_at_the_level_of_probabilities_are_warned_about() -> None:
    target = torch.ones(1, 1, 4, 4, 4)
    with pytest.warns(UserWarning, match=r"level=0\.0"):
        TopologyMetric().update(5 * target, target)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        TopologyMetric(level=0.0).update(5 * target, target)
        TopologyMetric().update(target, target)
        TopologyMetric(2).update(torch.cat((-target, 5 * target), 1), target)
