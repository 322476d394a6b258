"""What must not matter: pose, scale, offset, order; and what must add up."""

from __future__ import annotations

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import topokit as tk
from topokit.testing import ellipsoid_samples, torus_samples

TORUS = torus_samples(700)
ELLIPSOID = ellipsoid_samples(500)
seeds = st.integers(0, 2**31 - 1)
few = settings(max_examples=6, deadline=None, derandomize=True)


def euler(points: Tensor, normals: Tensor | None = None) -> float:
    return float(tk.from_points(points, normals).gauss_bonnet())


def rotation(seed: int) -> Tensor:
    q, r = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64))
    q = q * r.diagonal().sign()
    return q * torch.linalg.det(q)


WITH_NORMALS, WITHOUT = euler(TORUS.points, TORUS.normals), euler(TORUS.points)


def same(found: float, expected: float, tolerance: float = 1e-6) -> bool:
    return abs(found - expected) < tolerance * (1 + abs(expected))


@few
@given(seed=seeds)
def test_rotation(seed: int) -> None:
    turn = rotation(seed)
    assert same(euler(TORUS.points @ turn, TORUS.normals @ turn), WITH_NORMALS)
    assert same(euler(TORUS.points @ turn), WITHOUT)


@few
@given(exponent=st.floats(-6, 6))
def test_scale(exponent: float) -> None:
    assert same(euler(TORUS.points * 10**exponent, TORUS.normals), WITH_NORMALS)
    assert same(euler(TORUS.points * 10**exponent), WITHOUT)


@few
@given(offset=st.tuples(*[st.floats(-1e6, 1e6)] * 3))
def test_offset(offset: tuple[float, float, float]) -> None:
    moved = TORUS.points + torch.tensor(offset, dtype=torch.float64)
    assert same(euler(moved, TORUS.normals), WITH_NORMALS)
    assert same(euler(moved), WITHOUT)


@few
@given(seed=seeds)
def test_permutation(seed: int) -> None:
    order = torch.randperm(700, generator=torch.Generator().manual_seed(seed))
    assert same(euler(TORUS.points[order], TORUS.normals[order]), WITH_NORMALS)
    assert same(euler(TORUS.points[order]), WITHOUT)
    local = tk.from_points(TORUS.points).curvature()
    shuffled = tk.from_points(TORUS.points[order]).curvature()
    torch.testing.assert_close(shuffled.gaussian, local.gaussian[order])


@few
@given(seed=seeds)
def test_disjoint_union_adds(seed: int) -> None:
    turn = rotation(seed)
    points = torch.cat((TORUS.points, ELLIPSOID.points @ turn + 10))
    normals = torch.cat((TORUS.normals, ELLIPSOID.normals @ turn))
    assert same(euler(points, normals), WITH_NORMALS + euler(ELLIPSOID.points, ELLIPSOID.normals))
    assert same(euler(points), WITHOUT + euler(ELLIPSOID.points))


def test_float32_with_an_offset_loses_only_what_its_coordinates_lost() -> None:
    """Everything is computed from differences of neighbors: float32 is as good as its rounded coordinates are."""
    moved = (TORUS.points + 1000).float()
    exact = euler(moved.double(), TORUS.normals)
    assert same(euler(moved, TORUS.normals.float()), exact, 1e-4)
