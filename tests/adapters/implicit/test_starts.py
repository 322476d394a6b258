"""Samples that follow a level set from earlier ones: where they go, what they cost, and what is refused."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

import topokit as tk
from topokit.errors import InputError

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


class Torus(nn.Module):
    """The distance of a torus whose tube grows; counts the points at which it is evaluated."""

    def __init__(self) -> None:
        super().__init__()
        self.minor = nn.Parameter(torch.tensor(0.25))
        self.n_points = 0

    def forward(self, x: Tensor) -> Tensor:
        self.n_points += len(x)
        return self.distance(x) - self.minor

    def distance(self, x: Tensor) -> Tensor:
        """From the circle in the middle of the tube."""
        return torch.hypot(torch.hypot(x[:, 0], x[:, 1]) - 0.55, x[:, 2])


def test_samples_follow_a_training_at_a_small_part_of_the_cost() -> None:
    torus = Torus()
    samples = tk.from_sdf(torus, bounds=BOX, n_samples=1500).samples
    for _ in range(5):
        with torch.no_grad():
            torus.minor += 0.01
        torus.n_points = 0
        shape = tk.from_sdf(torus, bounds=BOX, starts=samples.points, resolution=128)
        samples = shape.samples
        assert torus.n_points < 10 * 1500
        assert samples.n_points == 1500
        torch.testing.assert_close(torus.distance(samples.points), torus.minor.expand(1500), atol=1e-5, rtol=0)
    assert abs(float(shape.gauss_bonnet(boundary=False))) < 0.1
    assert samples.normals is not None
    (slope,) = torch.autograd.grad((samples.points * samples.normals.detach()).sum(-1).mean(), torus.minor)
    assert float(slope) == pytest.approx(1, abs=1e-4)  # the tube moves outward as fast as its radius grows
    assert shape.report().euler == 0


def test_starts_that_are_too_far_away_are_left_out() -> None:
    torus = Torus()
    near = tk.from_sdf(torus, bounds=BOX, n_samples=300).samples.points.detach()
    starts = torch.cat((near, torch.full((50, 3), 0.9)))
    followed = tk.from_sdf(torus, bounds=BOX, starts=starts.double().numpy())
    assert followed.samples.n_points == 300
    torch.testing.assert_close(followed.samples.points.detach(), near, atol=1e-5, rtol=0)
    with pytest.raises(InputError, match=r"none of the 50 starts is within 0\.0312 of the level set"):
        tk.from_sdf(torus, bounds=BOX, starts=starts[300:]).gauss_bonnet()


@pytest.mark.parametrize("starts", [torch.zeros(10, 2), torch.full((10, 3), torch.nan), torch.zeros(2, 10, 3)])
def test_starts_are_checked(starts: Tensor) -> None:
    with pytest.raises(InputError, match=r"starts must be finite points \(N, 3\)"):
        tk.from_sdf(Torus(), bounds=BOX, starts=starts)


def test_occupancies_can_be_followed_too() -> None:
    torus = Torus()
    starts = tk.from_sdf(torus, bounds=BOX, n_samples=300).samples.points
    shape = tk.from_occupancy(lambda x: -50 * torus(x), bounds=BOX, logits=True, starts=starts)
    torch.testing.assert_close(shape.samples.points.detach(), starts.detach(), atol=1e-5, rtol=0)
