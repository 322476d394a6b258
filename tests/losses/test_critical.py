"""Critical points: their kinds, their indices, and how the Euler loss pushes them."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from analytic_fields import grid, torus

from topokit.core.grid.euler import smoothed_euler, solid_euler
from topokit.errors import InputError
from topokit.losses import CriticalPoints, critical_points

DOUBLE = torch.float64
P = grid(16)
TORUS = torus(P, 0.5, 0.25)

both_connectivities = pytest.mark.parametrize("connectivity", [6, 26])


def saddle_field(*signs: int) -> torch.Tensor:
    """± x² ± y² ± z², with a slight slope so that no two voxels tie."""
    axis = torch.arange(-2.0, 3.0, dtype=DOUBLE)
    squares = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij")).square()
    slope = torch.arange(125, dtype=DOUBLE).reshape(5, 5, 5) * 1e-4
    return (torch.tensor(signs, dtype=DOUBLE)[:, None, None, None] * squares).sum(0) + slope


def kind_and_index_at_the_middle(points: CriticalPoints) -> tuple[str, int]:
    """Those of the one critical point among the middle 3 x 3 x 3 voxels."""
    near = ((points.voxels - 2).abs() <= 1).all(1).nonzero().flatten().tolist()
    assert len(near) == 1
    return points.kinds[near[0]], int(points.index[near[0]])


@both_connectivities
@pytest.mark.parametrize(
    ("signs", "kind", "index"),
    [
        ((-1, -1, -1), "appears", 1),
        ((1, -1, -1), "joins", -1),
        ((-1, -1, 1), "joins", -1),
        ((1, 1, -1), "closes", 1),
        ((-1, 1, 1), "closes", 1),
        ((1, 1, 1), "fills", -1),
    ],
)
def test_maximum_saddles_and_minimum(signs: tuple[int, int, int], kind: str, index: int, connectivity: int) -> None:
    points = critical_points(saddle_field(*signs), 2.0, 0.5, connectivity=connectivity)
    assert kind_and_index_at_the_middle(points) == (kind, index)


@both_connectivities
@pytest.mark.parametrize("rounded", [False, True])
def test_indices_sum_to_the_euler_characteristic_and_agree_with_the_kinds(
    connectivity: int, rounded: bool, generator: torch.Generator
) -> None:
    field = torch.randn(7, 6, 8, generator=generator, dtype=DOUBLE)
    field = (2 * field).round() / 2 if rounded else field  # with ties
    points = critical_points(field, 2.0, 0.5, level=0.25, connectivity=connectivity)
    assert points.index[points.values > 0].sum() == solid_euler(field, 0.25, connectivity)
    assert (points.values.abs().diff() >= 0).all()
    torch.testing.assert_close(points.values, field[tuple(points.voxels.T)] - 0.25)
    expected = {"appears": 1, "joins": -1, "closes": 1, "fills": -1}
    for kind, index in zip(points.kinds, points.index.tolist(), strict=True):
        if kind == "joins":
            assert index < 0  # several parts may join at once
        elif kind == "closes":
            assert index > 0
        else:
            assert kind == "several" or index == expected[kind], (kind, index)
    assert {"appears", "joins", "closes"} <= set(points.kinds)


@both_connectivities
def test_the_push_is_the_negative_gradient_and_raises_what_raises_chi(
    connectivity: int, generator: torch.Generator
) -> None:
    field = torch.randn(6, 6, 6, generator=generator, dtype=DOUBLE, requires_grad=True)
    loss = (smoothed_euler(field, 0.4, 0.1, connectivity) - 2).square()
    (slope,) = torch.autograd.grad(loss, field)
    points = critical_points(field, 2.0, 0.4, level=0.1, connectivity=connectivity)
    torch.testing.assert_close(points.push, -slope[tuple(points.voxels.T)])
    torch.testing.assert_close(points.push.sum(), -slope.sum())
    rises = points.push * (2.0 - smoothed_euler(field, 0.4, 0.1, connectivity).detach()).sign() > 0
    assert (rises == (points.index > 0)).all()


def test_the_hole_of_a_torus_is_closed_by_raising_a_saddle() -> None:
    points = critical_points(TORUS + 0.02 * P[..., 2], 2.0, 0.2)
    in_the_hole = P[tuple(points.voxels.T)].norm(dim=1) < 0.2
    closing = [k for k, kind in enumerate(points.kinds) if kind == "closes" and in_the_hole[k]]
    assert len(closing) == 1
    assert points.push[closing[0]] > 0
    assert points.values[closing[0]] < 0


def test_half_precision_no_grad_and_a_single_voxel() -> None:
    expected = critical_points(TORUS.float(), 2.0, 0.1).push.abs().sum()
    for dtype in (torch.float16, torch.bfloat16):
        total = critical_points(TORUS.to(dtype), 2.0, 0.1).push.abs().sum()
        assert total == pytest.approx(float(expected), rel=0.3)
    with torch.no_grad():
        assert len(critical_points(TORUS, 2.0, 0.1).voxels) > 0
    one = critical_points(torch.full((1, 1, 1), 0.5), 0.0, 1.0)
    assert (one.voxels.tolist(), one.kinds, one.index.tolist()) == ([[0, 0, 0]], ("appears",), [1])


def test_wrong_input_is_named() -> None:
    for field in (TORUS[None], torch.ones(2, 2, 2, dtype=torch.int64), torch.full((2, 2, 2), math.inf)):
        with pytest.raises(InputError) as caught:
            critical_points(field, 2.0, 0.1)
        assert str(caught.value) == (
            "critical points need one finite floating-point field (X, Y, Z); got shape "
            f"{tuple(field.shape)} and type {field.dtype}."
        )
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"tau": 0.0}, "tau"),
        ({"tau": 0.1, "connectivity": 18}, "connectivity"),
    ]
    for options, name in wrong:
        with pytest.raises(InputError, match=f"^{name} must be"):
            critical_points(TORUS, 2.0, **options)
