"""Neighbors in torch operations are SciPy's on twenty kinds of hostile clouds; ties are in the order of the indices."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hostile_clouds import CLOUDS
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.neighbors import nearest_neighbors
from topokit.core.neighbors.device import device_neighbors
from topokit.core.residence import as_on_accelerator
from topokit.errors import InputError
from topokit.testing import torus_samples

TREE, ALL_PAIRS = 0, 10**9  # points up to which all pairs are compared


def made(name: str, n_points: int, seed: int) -> Tensor:
    return CLOUDS[name](n_points, torch.Generator().manual_seed(seed))


def by_definition(points: Tensor, k: int) -> Tensor:
    """All pairs sorted by distance, then by index; the point itself left out."""
    difference = points.double()[:, None] - points.double()
    squared = difference[..., 0] ** 2 + difference[..., 1] ** 2 + difference[..., 2] ** 2
    return squared.fill_diagonal_(torch.inf).sort(dim=1, stable=True).indices[:, :k]


def distances(points: Tensor, neighbors: Tensor) -> np.ndarray:
    return (points.double()[neighbors] - points.double()[:, None]).norm(dim=-1).numpy()


def test_there_are_twenty_kinds() -> None:
    assert len(CLOUDS) == 20


@pytest.mark.parametrize("name", CLOUDS)
@settings(max_examples=6, deadline=None, derandomize=True)
@given(
    n_points=st.integers(40, 700),
    k=st.integers(3, 30),
    seed=st.integers(0, 2**20),
    dtype=st.sampled_from([torch.float64, torch.float32, torch.float16]),
)
def test_the_tree_finds_what_scipy_finds(name: str, n_points: int, k: int, seed: int, dtype: torch.dtype) -> None:
    points = made(name, n_points, seed).clamp(-6e4, 6e4).to(dtype)
    k = min(k, len(points) - 1)
    found = device_neighbors(points[None], k, None, TREE)[0]
    scipy, index = cKDTree(points.double().numpy()).query(points.double().numpy(), k + 1)
    np.testing.assert_allclose(distances(points, found), scipy[:, 1:], rtol=1e-12)
    assert torch.equal(found, by_definition(points, k))
    is_unique = np.append(np.diff(scipy) > 1e-9 * scipy[:, 1:], np.zeros((len(points), 1), bool), axis=1).all(1)
    assert np.array_equal(found.numpy()[is_unique], index[is_unique, 1:])


@pytest.mark.parametrize("name", CLOUDS)
def test_all_pairs_are_compared_right(name: str) -> None:
    points = made(name, 150, 3)
    assert torch.equal(device_neighbors(points[None], 9, None, ALL_PAIRS)[0], by_definition(points, 9))


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1e30, 1e300])
def test_neither_tiny_nor_huge_coordinates_are_lost(scale: float) -> None:
    points = made("sphere", 200, 0)
    found = device_neighbors((points * scale)[None], 6, None, TREE)[0]
    assert torch.equal(found, by_definition(points, 6))


@pytest.mark.parametrize("most", [TREE, ALL_PAIRS])
def test_items_of_a_batch_are_searched_each_on_its_own_up_to_its_length(most: int) -> None:
    clouds = [made(name, 300, 1) for name in ("sphere", "clusters", "few places", "lattice")]
    lengths = torch.tensor([300, 41, 170, 299])
    points = torch.stack(clouds)
    points[1, 41:] = torch.nan  # padding may hold anything
    found = device_neighbors(points, 8, lengths, most)
    for item, length, neighbors in zip(clouds, lengths.tolist(), found, strict=True):
        assert torch.equal(neighbors[:length], by_definition(item[:length], 8))
        assert (neighbors[length:] == torch.arange(length, 300)[:, None]).all()


@pytest.mark.parametrize("method", ["kd-tree", "device"])
def test_both_methods_take_batches_and_lengths(method: str) -> None:
    points = torch.stack([torus_samples(90).points, torus_samples(90, minor=0.2).points]).reshape(2, 1, 90, 3)
    lengths = torch.tensor([[90], [50]])
    found = nearest_neighbors(points, 5, lengths=lengths, method=method)
    assert found.shape == (2, 1, 90, 5)
    assert torch.equal(found[1, 0, :50], by_definition(points[1, 0, :50], 5))
    assert (found[1, 0, 50:] == torch.arange(50, 90)[:, None]).all()


@pytest.mark.parametrize("most", [TREE, ALL_PAIRS])
def test_a_point_that_is_nan_is_nobodys_neighbor(most: int) -> None:
    points = made("uniform", 100, 2)
    points[17, 1] = torch.nan
    found = device_neighbors(points[None], 5, None, most)[0]
    others = torch.arange(100) != 17
    assert (found[17] == 17).all()
    assert (found[others] != 17).all()


def test_the_context_chooses_the_device_search() -> None:
    points = made("shuffled lattice", 300, 4)
    with as_on_accelerator():
        assert torch.equal(nearest_neighbors(points, 7), by_definition(points, 7))
    with pytest.raises(InputError, match="'octree' is unknown"):
        nearest_neighbors(points, 7, method="octree")  # type: ignore[arg-type]
