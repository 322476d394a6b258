"""Homotopy warping: what is kept, and where it ends."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_fields import ball, grid, torus
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from topokit.core.grid.betti import betti_numbers
from topokit.core.homotopy.deformation import deform
from topokit.core.homotopy.simple_points import PaddedSolid, is_simple
from topokit.errors import InputError

CONNECTIVITIES = (6, 26, None)

pairs = array_shapes(min_dims=3, max_dims=3, max_side=7).flatmap(
    lambda shape: st.tuples(arrays(bool, shape), arrays(bool, shape))
)


def both_betti_numbers(solid: np.ndarray) -> list[list[int]]:
    return [betti_numbers(solid, connectivity=one).tolist() for one in (6, 26)]


def blobs(seed: int, n: int = 14) -> np.ndarray:
    """Correlated noise with parts, tunnels and cavities."""
    noise = np.random.default_rng(seed).normal(size=(n, n, n))
    return noise + sum(np.roll(noise, 1, axis) for axis in range(3)) > 0.4


@given(pairs, st.sampled_from(CONNECTIVITIES))
@settings(max_examples=80, deadline=None)
def test_betti_numbers_are_kept_and_no_simple_voxel_differs(
    pair: tuple[np.ndarray, np.ndarray], connectivity: int | None
) -> None:
    solid, target = pair
    moved = deform(solid, target, connectivity)
    for one in (6, 26) if connectivity is None else (connectivity,):
        assert betti_numbers(moved, connectivity=one).equal(betti_numbers(solid, connectivity=one))
    padded = PaddedSolid(moved)
    left = padded.indices(moved != target)
    assert not is_simple(padded.codes(left), connectivity).any()
    assert (moved[solid == target] == solid[solid == target]).all()


@pytest.mark.parametrize("seed", range(3))
def test_larger_noise_keeps_its_betti_numbers_in_both_connectivities(seed: int) -> None:
    solid, target = blobs(seed), blobs(seed + 100)
    moved = deform(solid, target)
    assert both_betti_numbers(moved) == both_betti_numbers(solid)
    assert 0 < (moved != target).sum() < 0.8 * (solid != target).sum()


def test_the_target_is_reached_where_the_topologies_agree() -> None:
    p = grid(24)
    small, moved = (ball(p, 0.3, (-0.4, 0, 0)) > 0).numpy(), (ball(p, 0.5, (0.2, 0, 0)) > 0).numpy()
    assert (deform(small, moved) == moved).all()
    assert (deform(moved, small) == small).all()


def test_a_ball_warped_to_a_torus_keeps_a_membrane() -> None:
    p = grid(24)
    full, ring = (ball(p, 0.8) > 0).numpy(), (torus(p, 0.5, 0.25) > 0).numpy()
    moved = deform(full, ring)
    left = moved & ~ring
    assert both_betti_numbers(moved) == [[1, 0, 0]] * 2
    assert (ring <= moved).all()
    assert 0 < left.sum() < 0.1 * full.sum()
    assert left.any(2).sum() >= left.sum() - 2  # one voxel thick along the axis of the hole


def test_a_part_of_only_one_solid_is_neither_created_nor_removed() -> None:
    p = grid(20)
    one = (ball(p, 0.3, (-0.5, 0, 0)) > 0).numpy()
    two = one | (ball(p, 0.3, (0.5, 0, 0)) > 0).numpy()
    assert (deform(one, two) == one).all()
    shrunk = deform(two, one)
    assert (shrunk[:10] == one[:10]).all()
    assert shrunk[10:].sum() == 1


def test_the_result_is_deterministic_and_the_arguments_are_not_modified() -> None:
    solid, target = blobs(1), blobs(2)
    before = solid.copy(), target.copy()
    assert (deform(solid, solid) == solid).all()
    first = deform(solid, target)
    assert (deform(solid, target) == first).all()
    assert (solid == before[0]).all()
    assert (target == before[1]).all()


def test_exchanging_solid_and_background_gives_the_complement() -> None:
    """With 6 and 26 exchanged, too. The padding is even, so that the parities stay the same."""
    solid, target = blobs(3), blobs(4)
    framed = deform(~np.pad(solid, 2), ~np.pad(target, 2), 26)
    assert (framed[2:-2, 2:-2, 2:-2] == ~deform(solid, target, 6)).all()


def test_only_the_two_connectivities() -> None:
    solid = np.zeros((2, 2, 2), dtype=bool)
    with pytest.raises(InputError, match=r"^connectivity must be 6, 26 or None \(both\), not 4\.$"):
        deform(solid, ~solid, 4)
