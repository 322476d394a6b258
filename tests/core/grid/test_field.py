"""Fields on grids: χ_τ evaluated at critical vertices only, its default τ and its limits."""

from __future__ import annotations

import pytest
import torch
from analytic_fields import grid, torus
from torch import Tensor

from topokit.core.grid.euler import smoothed_euler, surface_euler
from topokit.core.grid.field import GridField
from topokit.core.grid.tau import default_tau, typical_step
from topokit.errors import InputError

TORUS = torus(grid(24), 0.6, 0.25)


def noise(n: int = 9) -> Tensor:
    return torch.randn(n, n, n, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("tau", [1e-3, 0.1, 2.0])
def test_critical_vertices_give_the_smoothed_characteristic_and_its_gradient(tau: float, connectivity: int) -> None:
    values = noise().requires_grad_()
    sparse = GridField(values, connectivity=connectivity).smoothed_euler(tau)
    whole = smoothed_euler(values, tau, 0.0, connectivity)
    torch.testing.assert_close(sparse, whole)
    torch.testing.assert_close(torch.autograd.grad(sparse, values), torch.autograd.grad(whole, values))


def test_known_values_are_not_evaluated_again() -> None:
    class Counting(GridField):
        calls = 0

        def detached(self) -> Tensor:
            self.calls += 1
            return super().detached()

    field = Counting(TORUS)
    assert field.smoothed_euler(0.1, TORUS) == field.smoothed_euler(0.1)
    assert field.calls == 1


def test_no_tau_is_half_the_change_over_a_cell() -> None:
    assert typical_step(TORUS) == pytest.approx(2 / 23, rel=0.3)  # a distance, so at most one step
    assert default_tau(TORUS) == 0.5 * typical_step(TORUS)
    field = GridField(TORUS)
    assert field.smoothed_euler() == field.smoothed_euler(default_tau(TORUS))
    ramp = torch.arange(8.0).sub(3.5).mul(0.3).expand(8, 8, 8)
    assert default_tau(ramp) == pytest.approx(0.15)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_tau_zero_is_the_exact_integer(connectivity: int) -> None:
    field = GridField(noise(), connectivity=connectivity)
    assert field.smoothed_euler(0) == field.exact_euler() == surface_euler(noise(), 0.0, connectivity)
    assert field.exact_euler(32 - connectivity) == surface_euler(noise(), 0.0, 32 - connectivity)


def test_nan_is_not_hidden() -> None:
    values = TORUS.clone()
    values[0, 0, 0] = torch.nan
    assert GridField(values).smoothed_euler(0.1).isnan()


@pytest.mark.parametrize("tau", [-1.0, float("nan"), float("inf")])
def test_unusable_tau_is_refused(tau: float) -> None:
    with pytest.raises(InputError, match="tau must be a positive number"):
        GridField(TORUS).smoothed_euler(tau)


def test_a_field_of_one_sign_has_a_typical_step_all_the_same() -> None:
    ramp = torch.arange(8.0).mul(0.3).expand(8, 8, 8)
    assert typical_step(ramp + 1) == pytest.approx(0.3)
    assert typical_step((ramp + 1).clamp(max=1.5)) == pytest.approx(0.25)  # mean of what changes: 0.3 and 0.2
    assert typical_step(torch.full((4, 4, 4), -3.0)) == 3
    assert typical_step(torch.zeros(4, 4, 4)) == typical_step(torch.full((4, 4, 4), torch.inf)) == 1
    field = GridField(torch.ones(4, 4, 4))
    assert field.smoothed_euler(0) == 2
    assert field.smoothed_euler() > 0


def test_connectivity_is_checked() -> None:
    with pytest.raises(InputError, match=r"connectivity must be 6 or 26, not 18\."):
        GridField(TORUS, connectivity=18)
