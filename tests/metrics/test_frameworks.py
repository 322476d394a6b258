"""`TopologyMetric` in loops of the real torchmetrics and MONAI, in one process and in two."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.metrics import TopologyMetric

torchmetrics = pytest.importorskip("torchmetrics", reason="torchmetrics is not installed; make test installs it")
KINDS = ("betti_error", "betti_matching_error", "missing", "spurious", "matched")


def batches() -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Probabilities and masks (2, 1, 8, 7, 6)."""
    generator = np.random.default_rng(5)
    drawn = [torch.from_numpy(generator.random((2, 2, 1, 8, 7, 6))) for _ in range(3)]
    return [(one[0], (one[1] > 0.4).long()) for one in drawn]


def expected(pairs: list[tuple[torch.Tensor, torch.Tensor]], connectivity: int = 26) -> dict[str, float]:
    found = [
        tk.compare(p[0] > 0.5, t[0], connectivity=connectivity)
        for preds, target in pairs
        for p, t in zip(preds, target, strict=True)
    ]
    return {f"{kind}{k}": float(np.mean([getattr(one, kind)[k] for one in found])) for kind in KINDS for k in range(3)}


def same(found: dict[str, torch.Tensor], numbers: dict[str, float]) -> bool:
    return all(found[name].item() == pytest.approx(value) for name, value in numbers.items())


def test_a_collection_of_torchmetrics_counts_as_compare_does() -> None:
    metric = TopologyMetric(connectivity=26)
    collection = torchmetrics.MetricCollection(
        {
            "topology": metric.as_torchmetrics(),
            "dice": torchmetrics.classification.BinaryF1Score(),
        }
    )
    for number, (preds, target) in enumerate(batches()):
        one = collection(preds, target)  # forward: the batch by itself
        assert same(one, expected(batches()[number : number + 1]))
        metric.update(preds, target)
    assert same(collection.compute(), expected(batches()))
    assert same(metric.compute(), expected(batches()))
    assert 0 < collection.compute()["dice"] < 1
    collection.reset()
    with pytest.raises(tk.InputError, match="call update"), pytest.warns(UserWarning, match="before the ``update``"):
        collection.compute()


def test_metrics_of_other_options_stay_apart_in_a_collection() -> None:
    """A collection lets metrics share their sums if these are equal after the first batch."""
    solid = torch.zeros(1, 1, 6, 6, 6)
    solid[..., 1:3, 1:3, 1:3] = 1
    touching = solid.clone()
    touching[..., 3:5, 3:5, 3:5] = 1  # at a corner
    collection = torchmetrics.MetricCollection(
        {f"c{c}": TopologyMetric(connectivity=c).as_torchmetrics() for c in (6, 26)}
    )
    for preds in (solid, touching):
        collection.update(preds, solid)
    found = collection.compute()
    assert [found[f"c{c}_betti_error0"].item() for c in (6, 26)] == [0.5, 0.0]


def test_the_metric_of_torchmetrics_is_copied_pickled_saved_and_added_to_modules() -> None:
    metric = TopologyMetric(3).as_torchmetrics()
    target = torch.zeros(1, 6, 6, 6, dtype=torch.long)
    target[:, 1:3], target[:, 4:] = 1, 2
    metric.update(target.clamp(max=1), target)
    for other in (copy.deepcopy(metric), pickle.loads(pickle.dumps(metric)), metric.clone()):
        assert other.compute()["missing0"].tolist() == metric.compute()["missing0"].tolist() == [0, 1]
    metric.persistent(True)
    fresh = TopologyMetric(3).as_torchmetrics()
    fresh.load_state_dict(metric.state_dict())
    assert fresh.compute()["missing0"].tolist() == [0, 1]


def test_a_cumulative_metric_of_monai_counts_as_compare_does() -> None:
    monai = pytest.importorskip("monai.metrics", reason="MONAI is not installed; make test installs it")
    duck, real = TopologyMetric(connectivity=6), TopologyMetric(connectivity=6).as_monai()
    dice = monai.DiceMetric(include_background=True)
    assert isinstance(real, monai.CumulativeIterationMetric)
    for number, (preds, target) in enumerate(batches()):
        as_list = number == 1  # decollated, as MONAI's transforms leave a batch
        given = {"y_pred": [*preds] if as_list else preds, "y": [*target] if as_list else target}
        for metric in (duck, real):
            metric(**given)
        dice(y_pred=(preds > 0.5).float(), y=target)
    assert same(real.aggregate(), expected(batches(), 6))
    assert same(duck.aggregate(), expected(batches(), 6))
    assert 0 < dice.aggregate() < 1
    real.reset()
    with pytest.raises(tk.InputError, match="call update"):
        real.aggregate()


@pytest.mark.long
def test_the_example_tells_dice_from_topology() -> None:
    example = Path(__file__).parents[2] / "examples" / "evaluate_segmentation.py"
    ran = subprocess.run([sys.executable, example], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    little, lot = ran.stdout.splitlines()
    assert (little.split(":")[0], lot.split(":")[0]) == ("smoothed a little", "smoothed a lot")


_PROCESS = """
import sys, torch
sys.path.insert(0, {folder!r})
from test_frameworks import batches
from topokit.metrics import TopologyMetric
rank = int(sys.argv[1])
torch.distributed.init_process_group("gloo", init_method="file://" + sys.argv[2], rank=rank, world_size=2)
real, duck = TopologyMetric().as_torchmetrics(), TopologyMetric()
monai = TopologyMetric().as_monai()
for preds, target in batches()[rank::2]:  # two batches here, one there
    for metric in (real, duck):
        metric.update(preds, target)
    monai(y_pred=preds, y=target)
found = [one["missing1"].item() for one in (real.compute(), duck.compute(), monai.aggregate())]
if rank == 0:
    print(*found)
torch.distributed.destroy_process_group()
"""


@pytest.mark.long
def test_two_processes_reduce_to_the_numbers_of_one(tmp_path: Path) -> None:
    pytest.importorskip("monai", reason="MONAI is not installed; make test installs it")
    code = _PROCESS.format(folder=str(Path(__file__).parent))
    command = [sys.executable, "-c", code]
    running = [
        subprocess.Popen([*command, str(rank), str(tmp_path / "meeting")], stdout=subprocess.PIPE, text=True)
        for rank in (0, 1)
    ]
    output = [one.communicate(timeout=250)[0] for one in running]
    assert [one.returncode for one in running] == [0, 0]
    numbers = [float(word) for word in output[0].split()]
    assert numbers == pytest.approx([expected(batches())["missing1"]] * 3)
