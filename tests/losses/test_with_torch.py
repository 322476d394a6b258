"""The topology loss beside what trainings use: accumulation, autocast, compilers, processes, Lightning, MONAI."""

from __future__ import annotations

import copy
import os
from pathlib import Path

import pytest
import torch
from analytic_fields import ball, grid, torus
from torch import Tensor, nn

import topokit as tk
from topokit.errors import InputError

P = grid(12).float()
FIELDS = torch.stack([torus(P, 0.5, 0.25), torus(P, 0.55, 0.3), ball(P, 0.5), torus(P, 0.6, 0.25)])[:, None]


class Net(nn.Module):
    """A network from volumes to log-odds (B, X, Y, Z), near the identity."""

    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Conv3d(1, 1, 3, padding=1)
        nn.init.dirac_(self.layer.weight)
        nn.init.zeros_(self.layer.bias)

    def forward(self, x: Tensor) -> Tensor:
        return self.layer(x)[:, 0]


def gradient(net: nn.Module, batches: list[Tensor], loss: tk.TopologyLoss) -> Tensor:
    """Of the mean of the batches' losses, with respect to the weights."""
    for batch in batches:
        (loss(net(batch)) / len(batches)).backward()
    return torch.cat([parameter.grad.flatten() for parameter in net.parameters()])


def test_accumulated_gradients_are_those_of_the_whole_batch() -> None:
    loss = tk.TopologyLoss(genus=0)
    whole = gradient(Net(), [FIELDS], loss)
    assert whole.abs().max() > 0
    torch.testing.assert_close(gradient(Net(), [FIELDS[:2], FIELDS[2:]], loss), whole)


def test_a_network_under_autocast_with_scaled_gradients() -> None:
    """Its output has half precision, whose gradient is that of the same numbers in single precision."""
    net, loss = Net(), tk.TopologyLoss(genus=0)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        output = net(FIELDS)
        value = loss(output)
    assert output.dtype == torch.bfloat16
    assert value.dtype == torch.float32
    (slope,) = torch.autograd.grad(1024 * value, output)
    exact = output.detach().float().requires_grad_()
    (expected,) = torch.autograd.grad(1024 * loss(exact), exact)
    torch.testing.assert_close(slope, expected.bfloat16())


def test_a_compiled_network() -> None:
    torch._dynamo.reset()
    net = Net()
    expected = gradient(copy.deepcopy(net), [FIELDS], tk.TopologyLoss(genus=0))
    found = gradient(torch.compile(net, backend="aot_eager", fullgraph=True), [FIELDS], tk.TopologyLoss(genus=0))
    torch.testing.assert_close(found, expected)


def in_a_process(rank: int, folder: str) -> None:
    torch.set_num_threads(1)
    torch.distributed.init_process_group("gloo", init_method=f"file://{folder}/store", rank=rank, world_size=2)
    net = nn.parallel.DistributedDataParallel(Net())
    found = gradient(net, [FIELDS[2 * rank : 2 * rank + 2]], tk.TopologyLoss(genus=0))
    torch.save(found, f"{folder}/{rank}.pt")
    torch.distributed.destroy_process_group()


@pytest.mark.long
@pytest.mark.skipif(not torch.distributed.is_available(), reason="this torch has no torch.distributed")
@pytest.mark.skipif(os.name == "nt", reason="gloo with a file store needs a POSIX system")
def test_two_processes_get_the_gradients_of_one(tmp_path: Path) -> None:
    torch.multiprocessing.spawn(in_a_process, (str(tmp_path),), nprocs=2)
    expected = gradient(Net(), [FIELDS], tk.TopologyLoss(genus=0))
    for rank in range(2):
        torch.testing.assert_close(torch.load(tmp_path / f"{rank}.pt"), expected)


MASK = torch.zeros(1, 1, 16, 16, dtype=torch.long)
MASK[..., 2:14, 3:5] = 1
MASK[..., 2:14, 10:12] = 2


def logits_of(mask: Tensor, scale: float = 4.0) -> Tensor:
    """Logits (B, 3, ...) of class numbers (B, 1, ...)."""
    return scale * torch.nn.functional.one_hot(mask[:, 0], 3).movedim(-1, 1).float()


@pytest.mark.parametrize("depth", [False, True])
def test_classes_are_compared_with_their_masks_in_place(depth: bool) -> None:
    mask = MASK[..., None].repeat(1, 1, 1, 1, 3) if depth else MASK
    loss = tk.losses.SegmentationTopologyLoss(include_background=False, softmax=True, reduction="none")
    right, moved = logits_of(mask), logits_of(mask)
    moved[:, 2, 7:9], moved[:, 0, 7:9, 10:12] = -4.0, 4.0  # class 2 is broken here ...
    moved[:, 2, 2:5, 14:16] = 9.0  # ... and has a piece where there is none
    moved.requires_grad_()
    assert torch.equal(loss(right, mask), torch.zeros(1, 2))
    values = loss(moved, mask)
    assert (values > 0).tolist() == [[False, True]]
    assert tk.topology_loss(right.detach()[:, 2], betti=(1, 0, 0) if depth else (1, 0), level=2.0) == 0
    (slope,) = torch.autograd.grad(values.sum(), moved)
    assert (slope[:, 2, 7:9, 10:12] < 0).any()  # raised
    assert (slope[:, 2, 2:5, 14:16] > 0).all()  # lowered
    one_hot = logits_of(mask, 1.0)
    assert torch.equal(loss(moved.detach(), one_hot), values.detach())
    whole = tk.losses.SegmentationTopologyLoss(softmax=True)(moved.detach(), mask)
    assert whole > 0
    chances = moved.detach().sigmoid()
    by_chances = tk.losses.SegmentationTopologyLoss(include_background=False, reduction="none")(chances, mask)
    by_odds = tk.losses.SegmentationTopologyLoss(False, sigmoid=True, reduction="none")(moved.detach(), mask)
    assert ((by_chances > 0) == (by_odds > 0)).all()


def test_probabilities_have_the_slopes_of_their_log_odds() -> None:
    odds = logits_of(MASK)
    odds[:, 2, 7:9] = -4.0
    odds.requires_grad_()
    by_odds = tk.losses.SegmentationTopologyLoss(sigmoid=True)(odds, MASK)
    by_chances = tk.losses.SegmentationTopologyLoss()(odds.sigmoid(), MASK)
    torch.testing.assert_close(by_chances, by_odds)
    slopes = [torch.autograd.grad(one, odds)[0] for one in (by_chances, by_odds)]
    assert slopes[1].abs().max() > 0
    torch.testing.assert_close(*slopes)


def test_weight_one_is_in_proportion_to_a_cross_entropy_however_sure_the_network_is() -> None:
    """A wrong voxel that decides is pushed by ten times the largest slope of a mean cross-entropy."""
    for scale in (4.0, 40.0):
        odds = logits_of(MASK, 2 * scale)[:, 2:] - scale
        odds[:, :, 7:9] = -scale
        odds.requires_grad_()
        loss = tk.losses.SegmentationTopologyLoss(sigmoid=True)(odds, MASK == 2)
        (slope,) = torch.autograd.grad(loss, odds)
        assert slope.abs().max() * odds.numel() == pytest.approx(10.0)


def test_wrong_segmentations_are_named() -> None:
    with pytest.raises(InputError, match="values below 0 or above 1; for log-odds pass sigmoid=True"):
        tk.losses.SegmentationTopologyLoss()(logits_of(MASK), MASK)
    with pytest.raises(InputError, match="not both"):
        tk.losses.SegmentationTopologyLoss(sigmoid=True, softmax=True)
    with pytest.raises(InputError, match=r"expected an input .* got \(1, 3, 16, 16\) and \(1, 2, 16, 16\)"):
        tk.losses.SegmentationTopologyLoss()(logits_of(MASK), logits_of(MASK)[:, :2])


def test_the_arguments_are_those_of_monai() -> None:
    monai = pytest.importorskip("monai.losses")
    options = {"include_background": False, "softmax": True, "reduction": "mean"}
    logits = logits_of(MASK).requires_grad_()
    dice = monai.DiceLoss(**options, to_onehot_y=True)
    ours = tk.losses.SegmentationTopologyLoss(**options)
    (dice(logits, MASK) + ours(logits, MASK)).backward()
    assert logits.grad.isfinite().all()


def test_the_monitor_in_a_lightning_callback() -> None:
    lightning = pytest.importorskip("lightning.pytorch")
    monitor = tk.TopologyMonitor(tk.TopologyLoss(genus=0), every=1, patience=1)

    class Closing(lightning.LightningModule):
        def __init__(self) -> None:
            super().__init__()
            self.values = nn.Parameter(FIELDS[0, 0].clone())
            self.loss = tk.TopologyLoss(genus=0)

        def training_step(self, batch: object, number: int) -> Tensor:
            return self.loss(self.values, keys="it")

        def configure_optimizers(self) -> torch.optim.Optimizer:
            return torch.optim.Adam(self.parameters(), 0.05)

    def stop(trainer: object, module: Closing, *_: object) -> None:
        trainer.should_stop = monitor(trainer.global_step, module.values.detach())

    trainer = lightning.Trainer(
        max_epochs=1,
        accelerator="cpu",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        callbacks=[lightning.callbacks.LambdaCallback(on_train_batch_end=stop)],
    )
    trainer.fit(Closing(), torch.utils.data.DataLoader(range(100)))
    assert 1 <= trainer.global_step < 100
    assert monitor.history[-1].tunnels == 0
