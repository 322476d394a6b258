"""Local networks of cells, and the bounds that they give: compared with the function itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from topokit.core.implicit.bounds.local import KINKS, LocalNetworks, local_networks
from topokit.core.implicit.bounds.nested import nested, restricted
from topokit.core.implicit.bounds.operations import program_of
from topokit.core.implicit.bounds.program import Program

Function = Callable[[Tensor], Tensor]


class Branches(nn.Module):
    """Parallel kinks, a skip connection, leaky ones and a maximum."""

    def __init__(self) -> None:
        super().__init__()
        self.first, self.second, self.third = nn.Linear(3, 10), nn.Linear(13, 10), nn.Linear(10, 2)

    def forward(self, x: Tensor) -> Tensor:
        inner = torch.relu(self.first(x))
        both = self.third(nn.functional.leaky_relu(self.second(torch.cat((inner, x), 1)), 0.2))
        return torch.maximum(both[:, 0], both[:, 1]) + 0.3 * x.abs().sum(1)


def deep() -> nn.Module:
    layers: list[nn.Module] = [nn.Linear(3, 16), nn.ReLU()]
    for _ in range(3):
        layers += [nn.Linear(16, 16), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(16, 1))


NETWORKS = {"deep": deep, "branches": Branches}


def example(name: str, seed: int) -> tuple[Function, Program, Tensor, Tensor]:
    """A network with weights in single precision, its program, and boxes of which half are near the level set."""
    torch.manual_seed(seed)
    net = NETWORKS[name]()
    for parameter in net.parameters():
        parameter.data *= 2
    centers, half = 2 * torch.rand(40, 3, dtype=torch.float64) - 1, torch.full((40, 3), 0.12, dtype=torch.float64)
    level = float(net(centers.float()).detach().median())

    def function(x: Tensor) -> Tensor:
        return net(x).reshape(-1) - level

    program = program_of(function, torch.zeros(1, 3), name)
    net.double()
    return function, program, centers, half


def evaluated(networks: LocalNetworks, network: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The function by its local networks at places (n, 3) in their boxes, and the error that is allowed."""
    values, errors = [], []
    for number, place in zip(network, at, strict=True):
        rows, count = networks.rows[number], networks.count[number]
        kinks, off = np.zeros(rows.shape[1] - KINKS), np.zeros(rows.shape[1] - KINKS)
        for i in range(count + 1):
            value = rows[i, 0] + rows[i, 1:4] @ place + rows[i, KINKS:] @ kinks
            error = rows[i, 4] + np.abs(rows[i, KINKS:]) @ off
            if i < count:
                kinks[i], off[i] = max(value, 0.0), error
        assert (kinks <= 1 + 1e-9).all(), "rows are scaled"
        values.append(value)
        errors.append(error)
    return np.array(values), np.array(errors)


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("seed", range(3))
def test_local_networks_are_the_function_and_bound_it_inside(name: str, seed: int) -> None:
    function, program, centers, half = example(name, seed)
    networks = local_networks(program, program.forms(centers, half))
    assert networks.count.max() > 3
    generator = np.random.default_rng(seed)
    network, depth = np.repeat(np.arange(40), 20), 0.5 ** generator.integers(1, 6)
    corner = generator.integers(0, round(1 / depth), (800, 3))
    offset, scale = (2 * corner + 1) * depth - 1, np.full(3, depth * (1 + 1e-12))
    found = nested(networks, network, offset, scale)
    smaller = restricted(networks, network, found.state)
    assert (smaller.count <= networks.count[network]).all()
    gradient = found.gradient(np.arange(800), half[0].numpy())
    settled = 0
    for turn in range(6):
        inside = generator.uniform(-1, 1, (800, 3))
        at = offset + depth * (np.sign(inside) if turn % 3 == 0 else inside)
        x = (centers[network] + half[network] * torch.from_numpy(at)).requires_grad_(True)
        value = function(x)
        (slope,) = torch.autograd.grad(value.sum(), x)
        exact = value.detach().numpy()
        for local, own in ((networks, network), (smaller, np.arange(800))):
            by_local, allowed = evaluated(local, own, at)
            assert (np.abs(by_local - exact) <= allowed + 1e-13).all()
            assert allowed.max() < 1e-10
        assert (exact[found.sign > 0] > 0).all()
        assert (exact[found.sign < 0] < 0).all()
        settled = int((found.sign != 0).sum())
        directions = torch.from_numpy(generator.normal(size=(800, 4, 3)))
        least = gradient.least(directions)
        products = (directions * slope[:, None]).sum(2)
        assert not bool((products < least)[torch.from_numpy(found.sign == 0)].any())
    assert 50 < settled < 800


@pytest.mark.parametrize("name", NETWORKS)
def test_smaller_boxes_have_fewer_kinks(name: str) -> None:
    _, program, centers, half = example(name, 0)
    networks = local_networks(program, program.forms(centers, half))
    counts = []
    for depth in (0.5, 0.5**12):
        found = nested(networks, np.arange(40), np.full((40, 3), 0.3), np.full(3, depth))
        counts.append(restricted(networks, np.arange(40), found.state).count.sum())
    assert counts[1] < 0.1 * counts[0]
