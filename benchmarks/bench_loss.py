"""Time and memory of a step of the losses, compared with a max-pooling of the same grid and with a persistence loss.

python -m pytest benchmarks/bench_loss.py -s              also --device cuda
python -m benchmarks.bench_loss memory      peak memory of one step at 128³, in this process
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time

import pytest
import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, max_pool3d

import topokit as tk
from benchmarks.timing import seconds
from benchmarks.topology_tasks import TASKS, GridModel, PersistenceLoss, fit, noisy_distances


def torus(size: int) -> Tensor:
    """A torus with a little noise, (size, size, size); made layer by layer, to need no memory beyond the result."""
    generator = torch.Generator().manual_seed(0)
    axis = torch.linspace(-1, 1, size)
    field = torch.empty(size, size, size)
    for layer, x in zip(field, axis, strict=True):
        ring = torch.hypot(x, axis) - 0.5
        layer[:] = 0.25 - torch.hypot(ring[:, None], axis) + 0.005 * torch.randn(size, size, generator=generator)
    return field


def median_step(step: Callable[[Tensor], Tensor], field: Tensor, repeats: int) -> float:
    """Median time of forward and backward."""
    times = []
    for _ in range(repeats):
        leaf = field.clone().requires_grad_()
        times.append(seconds(lambda leaf=leaf: step(leaf).backward(), field.device))
    return statistics.median(times)


def test_euler_loss_at_128_against_one_max_pooling(device: torch.device) -> None:
    field = torus(128).to(device)
    loss = tk.EulerLoss(2.0)
    ours = median_step(lambda f: loss(f, 0.05), field, 9)
    pooling = median_step(lambda f: max_pool3d(f[None, None], 2, 1).sum(), field, 9)
    print(f"\nEulerLoss at 128³: {1e3 * ours:.0f} ms, {ours / pooling:.2f} × one max_pool3d(2, 1)")
    assert ours <= 3 * pooling


def test_topology_loss_at_64_against_a_persistence_loss(device: torch.device) -> None:
    """Mean over a training of 40 steps, which includes the searches for the nearest solid; persistence on the CPU."""
    task = TASKS[0]
    start = fit("grid", task, 64).field().detach()
    loss = tk.TopologyLoss(genus=0, change="add")
    ours = mean_step(start.to(device), lambda field: loss(field, keys="torus"), 40)
    theirs = mean_step(start, PersistenceLoss(task.betti, 0.03), 4)
    print(f"\nstep at 64³: {1e3 * ours:.1f} ms with TopologyLoss, {theirs / ours:.0f} × that with persistence")
    assert theirs >= 20 * ours


def mean_step(start: Tensor, loss: Callable[[Tensor], Tensor], steps: int) -> float:
    """Mean time of the loss forward and backward in a training on a task."""
    model = GridModel(noisy_distances(TASKS[0], len(start)).to(start.device))
    model.values.data.copy_(start)
    optimizer = torch.optim.Adam(model.parameters(), 2e-3)
    total = 0.0
    for _ in range(steps):
        optimizer.zero_grad()
        model.objective(torch.Generator()).backward()
        total += seconds(lambda: loss(model.field()).backward(), start.device)
        optimizer.step()
    return total / steps


def test_topology_loss_of_a_network_at_64_against_a_step_of_its_training(device: torch.device) -> None:
    """A network of width 64 whose data term takes 2048 points; the grid of the loss has 65³, of which few decide.

    The steps take turns, so that a slow moment of the machine hits all. The means of 20 calls include the first, which
    evaluates all of the grid.
    """
    net = nn.Sequential(nn.Linear(3, 64), nn.Softplus(20), nn.Linear(64, 64), nn.Softplus(20), nn.Linear(64, 1))
    net.to(device)
    optimizer = torch.optim.Adam(net.parameters(), 1e-3)
    for _ in range(150):
        data_step(net, optimizer, device)
    shape = tk.from_sdf(net, bounds=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)))
    loss = tk.TopologyLoss(genus=1)
    calls: dict[str, Callable[[], Tensor]] = {
        "all of the grid": lambda: loss(shape),
        "near the level": lambda: loss(shape, keys="net"),
    }
    times: dict[str, list[float]] = {name: [] for name in ("data", *calls)}
    for _ in range(20):
        times["data"].append(seconds(lambda: data_step(net, optimizer, device), device, process_time))
        for name, call in calls.items():
            times[name].append(seconds(lambda call=call: call().backward(), device, process_time))
    step = statistics.mean(times["data"])
    ratios = {name: statistics.mean(times[name]) / step for name in calls}
    print(f"\nTopologyLoss of a network, in steps of its training of {1e3 * step:.1f} ms each:")
    print("\n".join(f"{name}: {ratio:.1f}" for name, ratio in ratios.items()))
    assert ratios["near the level"] < 0.4 * ratios["all of the grid"]


def test_segmentation_loss_at_64_against_a_step_of_a_unet(device: torch.device) -> None:
    """Smooth solids, predicted with errors. Both take turns; on the CPU two volumes stand for 32, as time is linear."""
    networks, losses = pytest.importorskip("monai.networks.nets"), pytest.importorskip("monai.losses")
    count = 2 if device.type == "cpu" else 32
    net = networks.UNet(3, 1, 2, (32, 64, 128, 256), (2, 2, 2), num_res_units=2).to(device)
    n_parameters = sum(parameter.numel() for parameter in net.parameters())
    generator = torch.Generator().manual_seed(0)
    coarse, fine = (torch.randn(count, 1, n, n, n, generator=generator).to(device) for n in (8, 16))
    truth, error = (interpolate(noise, size=(64,) * 3, mode="trilinear") for noise in (coarse, 0.5 * fine))
    masks, images = (truth > 0).long(), truth + error
    dice = losses.DiceCELoss(include_background=False, softmax=True, to_onehot_y=True)
    ours = tk.losses.SegmentationTopologyLoss(include_background=False, softmax=True)
    logits = torch.cat((-images, images), 1).requires_grad_()
    rows = [
        (
            seconds(lambda: dice(net(images), masks).backward(), device, process_time),
            seconds(lambda: ours(logits, masks).backward(), device, process_time),
        )
        for _ in range(3)
    ][1:]
    step, loss = (statistics.median(column) for column in zip(*rows, strict=True))
    print(
        f"\n{count} volumes of 64³: U-Net of {n_parameters} parameters {step:.2f} s, the loss {loss / step:.3f} of that"
    )
    assert n_parameters >= 4_500_000
    assert loss <= step


def data_step(net: nn.Module, optimizer: torch.optim.Optimizer, device: torch.device) -> None:
    points = 2 * torch.rand(2048, 3, device=device) - 1
    distance = torch.hypot(points[:, :2].norm(dim=1) - 0.6, points[:, 2]) - 0.25
    optimizer.zero_grad()
    (net(points)[:, 0] - distance).abs().mean().backward()
    optimizer.step()


def test_memory_at_128_is_at_most_ten_grids() -> None:
    command = [sys.executable, "-m", "benchmarks.bench_loss", "memory"]
    grids = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    print(f"\npeak memory of a step at 128³ beyond the field itself: {grids}")
    assert max(grids.values()) <= 10


def memory() -> dict[str, float]:
    """Peak memory of a step, in grids, beyond that of the field itself and of a step on a small grid."""
    grids = {}
    for name, loss in (("EulerLoss", tk.EulerLoss(2.0)), ("TopologyLoss", tk.TopologyLoss(genus=0))):
        loss(torus(16).requires_grad_(), 0.05).backward()
        field = torus(128).requires_grad_()
        before = peak()
        loss(field, 0.05).backward()
        grids[name] = round((peak() - before) / field.nbytes, 1)
    return grids


def peak() -> int:
    """Largest resident memory of this process so far, in bytes; getrusage would start with that of its parent."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


if __name__ == "__main__":
    print(json.dumps(memory()))
