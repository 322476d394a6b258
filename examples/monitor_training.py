"""Train on 32 clouds of 4096 points at once, and watch the topology of each at every step.

python examples/monitor_training.py                                     # on a GPU if there is one
python examples/monitor_training.py --clouds 2 --points 1000 --steps 5  # some seconds on a CPU

A network learns to twist spheres and tori. It must not tear them: χ by Gauss–Bonnet has to stay near 2 and 0. Watching
is one batched call per step, without a loop over the clouds; on a GPU nothing visits the host until the numbers are
printed at the end.
"""

from __future__ import annotations

import argparse
import time

import torch
from torch import Tensor, nn

import topokit as tk


def arguments() -> argparse.Namespace:
    """Sizes from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clouds", type=int, default=32)
    parser.add_argument("--points", type=int, default=4096)
    parser.add_argument("--steps", type=int, default=20)
    return parser.parse_args()


def spheres_and_tori(n_clouds: int, n_points: int, device: torch.device) -> Tensor:
    """Evenly spread points (B, N, 3): spheres in the first half of the batch, tori around the z axis in the second."""
    number = torch.arange(n_points, device=device) + 0.5
    height = 2 * number / n_points - 1
    angle = 2 * torch.pi * (number * (5**0.5 - 1) / 2 % 1)  # multiples of the golden angle
    radius = (1 - height**2).sqrt()
    sphere = 0.8 * torch.stack((radius * angle.cos(), radius * angle.sin(), height), -1)
    tube = torch.pi * height
    for _ in range(20):  # the area up to an angle t of the tube grows as t + (r / R) sin t
        tube = torch.pi * height - 0.4 * tube.sin()
    ring = 0.7 + 0.28 * tube.cos()
    torus = torch.stack((ring * angle.cos(), ring * angle.sin(), 0.28 * tube.sin()), -1)
    return torch.stack([sphere] * (n_clouds // 2) + [torus] * (n_clouds - n_clouds // 2))


def twisted(points: Tensor) -> Tensor:
    """Points (..., 3) turned around the x axis, the farther along it the more."""
    x, y, z = points.unbind(-1)
    return torch.stack((x, x.cos() * y - x.sin() * z, x.sin() * y + x.cos() * z), -1)


class Deformation(nn.Module):
    """Moves each point by a network of its place and of a code of its cloud (PointNet)."""

    def __init__(self, width: int = 128) -> None:
        super().__init__()
        self.encoder = nn.Sequential(nn.Linear(3, width), nn.SiLU(), nn.Linear(width, width))
        self.decoder = nn.Sequential(
            nn.Linear(width + 3, width), nn.SiLU(), nn.Linear(width, width), nn.SiLU(), nn.Linear(width, 3)
        )

    def forward(self, points: Tensor) -> Tensor:
        """Moved points (B, N, 3)."""
        codes = self.encoder(points).amax(1, keepdim=True).expand(-1, points.shape[1], -1)
        return points + self.decoder(torch.cat((codes, points), dim=-1))


def now(device: torch.device) -> float:
    """Seconds, when all work on the device is done."""
    if device.type == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter()


def main() -> None:
    """Train, watch, and print what was seen and what the watching took."""
    sizes = arguments()
    torch.manual_seed(0)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    clouds = spheres_and_tori(sizes.clouds, sizes.points, device)
    net = Deformation().to(device)
    optimizer = torch.optim.Adam(net.parameters(), 3e-3)
    errors, seen, training, watching = [], [], 0.0, 0.0
    for _ in range(sizes.steps):
        started = now(device)
        points = net(clouds)
        loss = (points - twisted(clouds)).square().sum(-1).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        trained = now(device)
        seen.append(tk.from_points(points.detach()).gauss_bonnet(20, boundary=False))
        errors.append(loss.detach())
        training, watching = training + trained - started, watching + now(device) - trained
    history = torch.stack(seen)
    spheres, tori = history[:, : sizes.clouds // 2], history[:, sizes.clouds // 2 :]
    print(f"{sizes.clouds} clouds of {sizes.points} points on {device.type}; error {errors[0]:.3f} to {errors[-1]:.3f}")
    for name, values in (("spheres", spheres), ("tori", tori)):
        print(f"χ of the {name}: {values.min():+.2f} to {values.max():+.2f}")
    print(f"a step: {1e3 * training / sizes.steps:.0f} ms; watching adds {100 * watching / training:.0f} %")


if __name__ == "__main__":
    main()
