"""Train a network to a torus until its topology is proven, which no grid can.

python examples/certify_network.py
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

import topokit as tk


def torus(x: Tensor) -> Tensor:
    """Signed distance to a torus."""
    across = torch.stack((x[:, :2].norm(dim=1) - 0.6, x[:, 2]), dim=1)
    return across.norm(dim=1) - 0.2


def main() -> None:
    """Train, count on grids, and prove."""
    torch.manual_seed(0)
    hidden = [layer for _ in range(2) for layer in (nn.Linear(32, 32), nn.ReLU())]
    net = nn.Sequential(nn.Linear(3, 32), nn.ReLU(), *hidden, nn.Linear(32, 1))
    optimizer = torch.optim.Adam(net.parameters(), lr=5e-3)
    monitor = tk.TopologyMonitor(tk.TopologyLoss(genus=1), every=100, certify=60)
    for step in range(3000):
        points = 2 * torch.rand(1024, 3) - 1
        loss = (net(points)[:, 0] - torus(points)).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step >= 1000 and monitor(step, tk.from_sdf(net, bounds=(-1, 1))):
            break
    print(f"step {step}: {monitor.certificate}")
    report = tk.from_sdf(net, bounds=(-1, 1)).report(certify=True)
    print(report)
    assert (report.verdict, report.genus) == ("certain", 1)


if __name__ == "__main__":
    main()
