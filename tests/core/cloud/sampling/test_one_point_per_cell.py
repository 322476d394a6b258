"""Summaries of clouds by cells: the same, to the last bit, however the points are split and joined."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from topokit.core.cloud.sampling.larger_than_memory import reduced
from topokit.core.cloud.sampling.one_point_per_cell import FINEST, Cells, cell_keys, joined

Floats = NDArray[np.float64]


def torus(n_points: int, noise: float = 0.0, seed: int = 0) -> Floats:
    rng = np.random.default_rng(seed)
    u, v = 2 * np.pi * rng.random((2, n_points))
    ring = 1 + 0.4 * np.cos(v)
    points = np.stack((ring * np.cos(u), ring * np.sin(u), 0.4 * np.sin(v)), axis=1)
    return points + noise * rng.normal(size=points.shape)


@st.composite
def clouds(draw: st.DrawFn) -> Floats:
    """Points of several scales, with duplicates, negative zeros and points that are absurdly far off."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    points = rng.normal(size=(draw(st.integers(1, 300)), 3)) * 10.0 ** draw(st.integers(-100, 100))
    points = points + draw(st.sampled_from([0.0, 1e6])) * np.abs(points).max()
    if draw(st.booleans()):
        points = np.round(points / np.abs(points).max() * 4)
    points[rng.random(len(points)) < 0.1] *= 10.0 ** draw(st.integers(0, 40))
    return np.concatenate((points, points[:: draw(st.integers(1, 9))]))


def assert_same(one: Cells, other: Cells) -> None:
    one, other = one.sorted(), other.sorted()
    assert one.exponent == other.exponent
    assert (one.points == other.points).all()
    assert (one.count == other.count).all()
    assert (one.normals is None) == (other.normals is None)
    if one.normals is not None and other.normals is not None:
        assert (one.normals == other.normals).all()


@settings(max_examples=60, deadline=None)
@given(clouds(), st.data())
def test_a_summary_does_not_depend_on_splits_or_order(points: Floats, data: st.DataObject) -> None:
    most = data.draw(st.integers(1, 200))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    has_normals = data.draw(st.booleans())
    normals = rng.normal(size=points.shape) if has_normals else None
    whole = joined([Cells.of(points, normals)], most)
    order = rng.permutation(len(points))
    parts = [
        joined([Cells.of(points[rows], None if normals is None else normals[rows])], most)
        for rows in np.array_split(order, data.draw(st.integers(1, 12)))
    ]
    while len(parts) > 1:  # any tree, and points that come late
        first, second, *rest = (parts[index] for index in rng.permutation(len(parts)))
        parts = [joined([first, second], most), *rest]
    assert_same(parts[0], whole)
    assert whole.count.sum() == len(points)
    if not has_normals or most >= 48:  # eight cells around the origin, six directions in each
        assert len(whole.points) <= max(most, 8)


@settings(max_examples=50, deadline=None)
@given(clouds(), st.integers(8, 100))
def test_cells_are_those_of_a_dictionary(points: Floats, most: int) -> None:
    found = joined([Cells.of(points)], most)

    def naive(exponent: int) -> dict[tuple[float, ...], int]:
        counts: dict[tuple[float, ...], int] = {}
        for point in points:
            place = tuple(float(x) for x in np.floor(point * 2.0**-exponent))
            counts[place] = counts.get(place, 0) + 1
        return counts

    expected = naive(found.exponent)
    own = {tuple(place): n for place, n in zip(np.floor(found.points * 2.0**-found.exponent), found.count, strict=True)}
    assert own == expected
    assert len(own) <= most
    assert found.exponent == FINEST or len(naive(found.exponent - 1)) > most
    assert {tuple(point) for point in found.points + 0.0} <= {tuple(point) for point in points + 0.0}


def test_two_sheets_in_one_cell_keep_a_point_each() -> None:
    """A plate far thinner than its cells."""
    plate = np.random.default_rng(0).random((4000, 3)) * (1, 1, 0)
    points = np.concatenate((plate, plate + np.array((0, 0, 1e-3))))
    normals = np.repeat([[0.0, 0, -1], [0, 0, 1]], 4000, axis=0)
    with_normals, without = joined([Cells.of(points, normals)], 700), joined([Cells.of(points)], 300)
    assert with_normals.exponent == without.exponent == -4
    assert len(with_normals.points) == 2 * len(without.points) == 512
    assert with_normals.normals is not None
    assert ((with_normals.points[:, 2] > 0) == (with_normals.normals[:, 2] > 0)).all()


def test_points_far_off_have_keys_of_their_own() -> None:
    points = np.concatenate((torus(500), [[1e9, 0, 0], [1e9, 0, 0.5], [1e30, 0, 0], [-1e120, 5, 5]]))
    keys = cell_keys(points, None, -3)
    assert len(set(keys[-4:].tolist())) == 4
    assert not set(keys[-4:].tolist()) & set(keys[:-4].tolist())
    assert (cell_keys(points[::-1], None, -3)[::-1][:-4] == keys[:-4]).all()


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_reduced_cloud_has_the_noise_of_the_cloud(noise: float) -> None:
    """One point for each cell alone has 1.6 times as much."""
    left = reduced(joined([Cells.of(torus(400_000, noise))], 40_000)).points
    distance = np.hypot(np.hypot(left[:, 0], left[:, 1]) - 1, left[:, 2]) - 0.4
    assert 6000 < len(left) < 40_000
    assert np.abs(distance.std() - noise) <= 0.05 * noise + 1e-12


def test_a_reduced_cloud_is_even_where_the_scan_is_not() -> None:
    """Half of the torus has 16 times as many points as the other half."""
    points = torus(1_000_000)
    points = points[(points[:, 0] > 0) | (np.arange(len(points)) % 16 == 0)]
    left = reduced(joined([Cells.of(points)], 20_000)).points
    assert 0.5 < (left[:, 0] > 0).sum() / (left[:, 0] < 0).sum() < 2


def test_haze_is_left_out_and_counted() -> None:
    haze = np.random.default_rng(1).random((2_000, 3)) * 40 - 20
    found = reduced(joined([Cells.of(np.concatenate((torus(200_000), haze)))], 10_000))
    far = np.abs(np.hypot(np.hypot(*found.points.T[:2]) - 1, found.points[:, 2]) - 0.4) > 0.1
    assert far.sum() == 0
    assert 1_900 < found.n_stray < 2_400  # corners of cells hold few points of the torus


def test_a_thinly_scanned_sheet_is_no_haze() -> None:
    """Two squares, one with a hundred times as many points, and as many points without a surface as the other has."""
    rng = np.random.default_rng(0)
    dense, thin = rng.random((400_000, 3)) * (1, 1, 0), rng.random((4_000, 3)) * (1, 1, 0) + (2, 0, 0.3)
    haze = rng.random((4_000, 3)) * (8, 8, 8) + (4, 0, 0)
    found = reduced(joined([Cells.of(np.concatenate((dense, thin, haze)))], 8_000))
    assert found.side == 1 / 32
    n_dense, n_thin = (int(((found.points[:, 0] // 2) == one).sum()) for one in (0, 1))
    assert 500 < n_thin <= 1100
    assert 500 < n_dense <= 1100
    assert (found.points[:, 0] > 4).sum() < 40


def test_few_points_are_all_kept() -> None:
    points = torus(1000)
    found = reduced(joined([Cells.of(np.concatenate((points, points)))], 1000))
    assert found.side == 0
    assert found.n_stray == 0
    assert (found.points == points[np.lexsort(points.T)]).all()
