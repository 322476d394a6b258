"""What topology costs beside the training of a DeepSDF network: 8 layers of width 512, 16 384 points a step.

    OMP_NUM_THREADS=1 python -m benchmarks.bench_deepsdf
    python -m benchmarks.bench_deepsdf --device cuda

Processor time within one run, on devices that of the wall, forward and backward, as multiples of a training step of one
shape; a batch of 64 shapes, as DeepSDF has, takes 64 times as long. Means of 20 calls follow from one call of each
kind: with `search_every=20` one evaluates all of the grid, and the others what lies near the level. The network is
added, hardly visible, to the distance of a torus, so that it need not be trained.

Reference:
    J. J. Park et al., "DeepSDF", CVPR 2019, doi:10.1109/CVPR.2019.00025 (layers, skip connection, points of a step).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from itertools import pairwise
from statistics import mean
from time import process_time

import torch
from torch import Tensor, nn
from torch.nn.utils.parametrizations import weight_norm

import topokit as tk
from benchmarks.timing import seconds

WIDTH, CODE, POINTS, CALLS, TAU, FOLLOWED = 512, 256, 16_384, 20, 0.02, 1500
BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


class DeepSDF(nn.Module):
    """Eight layers with weight normalization and a skip connection to the fifth, and a code."""

    def __init__(self) -> None:
        super().__init__()
        inputs = CODE + 3
        self.code = nn.Parameter(0.01 * torch.randn(CODE))
        self.before = nn.Sequential(*layers(inputs, WIDTH, WIDTH, WIDTH, WIDTH - inputs))
        self.after = nn.Sequential(*layers(WIDTH, WIDTH, WIDTH, WIDTH, WIDTH), nn.Linear(WIDTH, 1), nn.Tanh())

    def forward(self, x: Tensor) -> Tensor:
        """Signed distances (N,) at (N, 3)."""
        given = torch.cat((self.code.expand(len(x), -1), x), dim=1)
        added = self.after(torch.cat((self.before(given), given), dim=1))[:, 0]
        return torch.hypot(torch.hypot(x[:, 0], x[:, 1]) - 0.55, x[:, 2]) - 0.25 + 1e-2 * added


def layers(*widths: int) -> Iterator[nn.Module]:
    for before, after in pairwise(widths):
        yield weight_norm(nn.Linear(before, after))
        yield nn.ReLU()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", type=torch.device, default="cpu")
    device = parser.parse_args().device
    torch.manual_seed(0)
    net = DeepSDF().to(device)
    optimizer = torch.optim.Adam(net.parameters(), 1e-5)

    def training_step() -> None:
        points = 2 * torch.rand(POINTS, 3, device=device) - 1
        optimizer.zero_grad()
        (net(points).clamp(-0.1, 0.1) - 0.01).abs().mean().backward()
        optimizer.step()

    def timed(work: Callable[[], object]) -> float:
        return seconds(work, device, process_time)

    def backward(value: Tensor) -> None:
        optimizer.zero_grad()
        value.backward()

    shape = tk.from_sdf(net, bounds=BOX)
    samples = tk.from_sdf(net, bounds=BOX, n_samples=FOLLOWED).samples.points.detach()
    loss = tk.TopologyLoss(genus=1)
    once: dict[str, Callable[[], Tensor]] = {
        "smoothed_euler(tau) at 64³": lambda: shape.smoothed_euler(TAU),
        "smoothed_euler(tau) at 32³": lambda: tk.from_sdf(net, bounds=BOX, field_resolution=32).smoothed_euler(TAU),
        "gauss_bonnet(20, boundary=False) of 10 000 new samples": lambda: shape.gauss_bonnet(20, boundary=False),
        f"gauss_bonnet(20, boundary=False) of {FOLLOWED} samples that follow": lambda: tk.from_sdf(
            net, bounds=BOX, starts=samples
        ).gauss_bonnet(20, boundary=False),
    }
    training_step()  # the first takes longer
    step = mean(timed(training_step) for _ in range(3))
    print(f"a step of {POINTS} points: {step:.2f} s", flush=True)
    whole, near = (timed(lambda: backward(loss(shape, TAU, keys="net"))) / step for _ in range(2))
    print(f"TopologyLoss at 64³: all of the grid {whole:.1f} steps, near the level {near:.2f}")
    print(f"    mean of {CALLS} calls: {(whole + (CALLS - 1) * near) / CALLS:.2f} steps", flush=True)
    for name, value in once.items():
        print(f"{name}: {timed(lambda value=value: backward(value())) / step:.1f} steps", flush=True)


if __name__ == "__main__":
    main()
