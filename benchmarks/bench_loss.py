"""What a step of the topology loss costs, beside a max-pooling of the same grid and a persistence loss.

python -m pytest benchmarks/bench_loss.py -s
python -m benchmarks.bench_loss memory      peak memory of one step at 128³, in this process
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor
from torch.nn.functional import max_pool3d

import topokit as tk
from benchmarks.topology_tasks import TASKS, GridModel, PersistenceLoss, fitted, observed


def torus(size: int) -> Tensor:
    """A torus with a little noise, (size, size, size); made layer by layer, so that making it takes no memory."""
    generator = torch.Generator().manual_seed(0)
    axis = torch.linspace(-1, 1, size)
    field = torch.empty(size, size, size)
    for layer, x in zip(field, axis, strict=True):
        ring = torch.hypot(x, axis) - 0.5
        layer[:] = 0.25 - torch.hypot(ring[:, None], axis) + 0.005 * torch.randn(size, size, generator=generator)
    return field


def seconds(step: Callable[[Tensor], Tensor], field: Tensor, repeats: int) -> float:
    """Median time of forward and backward."""
    taken = []
    for _ in range(repeats):
        leaf = field.clone().requires_grad_()
        started = time.perf_counter()
        step(leaf).backward()
        taken.append(time.perf_counter() - started)
    return statistics.median(taken)


def test_chi_at_128_beside_one_max_pooling() -> None:
    field = torus(128)
    loss = tk.EulerLoss(2.0, components=None)
    ours = seconds(lambda f: loss(f, 0.05), field, 9)
    pooling = seconds(lambda f: max_pool3d(f[None, None], 2, 1).sum(), field, 9)
    print(f"\nχ_τ at 128³: {1e3 * ours:.0f} ms, {ours / pooling:.2f} × one max_pool3d(2, 1)")
    assert ours <= 3 * pooling


def test_guard_at_64_beside_a_persistence_loss() -> None:
    """A step is the mean over a whole training of 40 steps: the searches for the nearest solid are in it."""
    task = TASKS[0]
    start = fitted("grid", task, 64).field().detach()
    ours = mean_step(start, tk.EulerLoss(genus=0, change="add"), 40)
    theirs = mean_step(start, PersistenceLoss(task.betti, 0.03), 4)
    print(f"\nstep at 64³: {1e3 * ours:.1f} ms with the guard, {theirs / ours:.0f} × that with persistence")
    assert theirs >= 20 * ours


def mean_step(start: Tensor, loss: Callable[[Tensor], Tensor], steps: int) -> float:
    """Mean time of the loss forward and backward in a training on a task."""
    model = GridModel(observed(TASKS[0], len(start)))
    model.values.data.copy_(start)
    optimizer = torch.optim.Adam(model.parameters(), 2e-3)
    taken = 0.0
    for _ in range(steps):
        optimizer.zero_grad()
        model.objective(torch.Generator()).backward()
        started = time.perf_counter()
        (1e-3 * loss(model.field())).backward()
        taken += time.perf_counter() - started
        optimizer.step()
    return taken / steps


def test_memory_at_128_is_at_most_ten_grids() -> None:
    command = [sys.executable, "-m", "benchmarks.bench_loss", "memory"]
    grids = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    print(f"\npeak memory of a step at 128³ beyond the field itself: {grids}")
    assert max(grids.values()) <= 10


def memory() -> dict[str, float]:
    """Peak memory of a step, in grids, beyond what a step on a small grid and the field itself take."""
    found = {}
    for name, options in (("χ_τ", {"components": None}), ("guard and χ_τ", {})):
        loss = tk.EulerLoss(2.0, **options)
        loss(torus(16).requires_grad_(), 0.05).backward()
        loss.reset()
        field = torus(128).requires_grad_()
        before = peak()
        loss(field, 0.05).backward()
        found[name] = round((peak() - before) / field.nbytes, 1)
    return found


def peak() -> int:
    """Largest resident memory of this process so far, in bytes; getrusage would begin with that of its parent."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


if __name__ == "__main__":
    print(json.dumps(memory()))
