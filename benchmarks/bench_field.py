"""Cost of counting: networks on grids of 256³ and 512³ cells, and volumes of 512³ voxels beside scikit-image.

    python -m pytest benchmarks/bench_field.py -s            also --device cuda, where the networks are evaluated
    python benchmarks/bench_field.py network 256 512 cpu     one measurement, in this process: seconds, memory

Each measurement runs in a process of its own, so that its peak memory is its own.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from itertools import pairwise

import numpy as np
import pytest
import torch
from skimage.measure import euler_number
from torch import Tensor, nn

import topokit as tk

GIB = 1 << 30


class TorusNetwork(nn.Module):
    """A torus, bent a little by a network of about two million parameters (width 512) or fewer."""

    def __init__(self, width: int = 512, depth: int = 9) -> None:
        super().__init__()
        torch.manual_seed(0)
        sizes = [3] + [width] * depth
        layers = [layer for a, b in pairwise(sizes) for layer in (nn.Linear(a, b), nn.ReLU())]
        self.layers = nn.Sequential(*layers, nn.Linear(width, 1))

    def forward(self, x: Tensor) -> Tensor:
        torus = torch.hypot(x[:, :2].norm(dim=1) - 0.6, x[:, 2]) - 0.25
        return torus + 0.5 * self.layers(x)[:, 0]


def measure_network(n_cells: int, width: int, device: str) -> dict[str, float]:
    """χ of the network's level set on grids up to n_cells³."""
    net = TorusNetwork(width).requires_grad_(False).to(device)
    shape = tk.from_sdf(net, bounds=((-1.0,) * 3, (1.0,) * 3), resolution=n_cells)
    before = peak()
    started = time.perf_counter()
    answer = shape.counted
    assert answer is not None
    evaluations = shape.field.function.n_evaluations  # type: ignore[union-attr]
    return {
        "parameters": sum(weight.numel() for weight in net.parameters()),
        "euler": answer.evidence.integer or 0,
        "seconds": time.perf_counter() - started,
        "share": evaluations / (n_cells + 1) ** 3,
        "peak": peak(),
        "before": before,
    }


def ball_with_holes(n: int) -> np.ndarray:
    """A uint8 volume (n, n, n) of foam in a ball, made layer by layer so that making it takes no memory."""
    axis = np.linspace(-1, 1, n, dtype=np.float32)
    wave = np.sin(25 * axis)
    volume = np.empty((n, n, n), dtype=np.uint8)
    for i in range(n):
        radius = axis[i] ** 2 + axis[:, None] ** 2 + axis**2
        volume[i] = (wave[i] + wave[:, None] + wave < 0.8) & (radius < 0.9)
    return volume


def measure_volume(n: int, how: str) -> dict[str, float]:
    """Exact χ of the surface of a volume, three times; the best."""
    tk.from_voxels(np.ones((8, 8, 8), dtype=np.uint8)).smoothed_euler(0)  # imports are not measured
    seconds, euler, before = [], 0, peak()
    volume = ball_with_holes(n)
    for _ in range(3):
        started = time.perf_counter()
        if how == "topokit":
            euler = int(tk.from_voxels(volume, level=0, connectivity=26).smoothed_euler(0))
        else:
            euler = 2 * int(euler_number(volume > 0, connectivity=3))
        seconds.append(time.perf_counter() - started)
    return {"euler": euler, "seconds": min(seconds), "peak": peak(), "before": before, "volume": volume.nbytes}


def peak() -> int:
    """Largest resident memory of this process so far, in bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def in_own_process(*arguments: object) -> dict[str, float]:
    """Run one measurement of this file and read what it prints."""
    command = [sys.executable, __file__, *map(str, arguments)]
    found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    print("\n", *arguments, {key: round(value, 3) for key, value in found.items()})
    return found


@pytest.mark.timeout(1200)
def test_network_of_two_million_parameters_at_256(device: torch.device) -> None:
    found = in_own_process("network", 256, 512, device)
    assert found["parameters"] >= 2_000_000
    assert found["share"] <= 0.15


@pytest.mark.timeout(1200)
def test_network_at_512_stays_below_six_gibibytes(device: torch.device) -> None:
    found = in_own_process("network", 512, 64, device)
    assert found["peak"] < 6 * GIB


@pytest.mark.timeout(1200)
def test_volume_of_512_beside_scikit_image() -> None:
    ours, theirs = in_own_process("volume", 512, "topokit"), in_own_process("volume", 512, "skimage")
    assert ours["euler"] == theirs["euler"]
    assert ours["seconds"] * 2 <= theirs["seconds"]
    assert ours["peak"] - ours["before"] <= 4 * ours["volume"]  # the volume itself included


if __name__ == "__main__":
    kind, size, *options = sys.argv[1:]
    if kind == "network":
        print(json.dumps(measure_network(int(size), int(options[0]), options[1])))
    else:
        print(json.dumps(measure_volume(int(size), options[0])))
