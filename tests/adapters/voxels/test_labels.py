"""A labeled volume is counted label by label as if each were a volume of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk


@pytest.fixture
def volume() -> np.ndarray:
    """Random blobs of five labels, many of which touch each other and the border, with tunnels and cavities."""
    noise = np.random.default_rng(3).random((14, 15, 16))
    return np.digitize(noise, (0.5, 0.7, 0.8, 0.9, 0.95)).astype(np.int16) * 3


@pytest.mark.parametrize("connectivity", [6, 26])
def test_each_label_is_counted_as_by_itself(volume: np.ndarray, connectivity: int) -> None:
    options = {"spacing": (1.0, 0.5, 2.0), "connectivity": connectivity, "origin": (5.0, 0.0, -3.0)}
    shapes = tk.from_labels(volume, **options)
    assert list(shapes) == [3, 6, 9, 12, 15]
    for label, shape in shapes.items():
        found, expected = shape.report(), tk.from_voxels(volume, label=label, **options).report()
        assert found.name == f"voxels, label {label}"
        assert (found.euler, found.solid_betti, found.verdict) == (expected.euler, expected.solid_betti, "certain")
        assert found.per_component == expected.per_component  # their boxes in space, too
        assert found.reasons == expected.reasons  # also where the volume's border cuts the label


def test_samples_lie_where_the_label_is() -> None:
    volume = np.zeros((20, 20, 30), dtype=int)
    volume[3:9, 3:9, 3:9], volume[10:16, 10:16, 20:27] = 1, 2
    points = tk.from_labels(volume, [2], spacing=2.0, n_samples=500)[2].samples.points
    assert (points > 2 * 8.5).all()
    assert (points[:, :2] < 2 * 16).all()
    assert points[:, 2].max() > 2 * 25


def test_some_labels_of_a_file(volume: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "parts.npy", volume)
    shapes = tk.from_labels(tmp_path / "parts.npy", (12, 3))
    assert [shape.name for shape in shapes.values()] == ["parts.npy, label 12", "parts.npy, label 3"]


def test_every_label_has_the_same_seed(volume: np.ndarray) -> None:
    seeds = [tk.from_labels(volume, n_samples=50, generator=torch.Generator().manual_seed(s)) for s in (1, 1, 2)]
    points = [shapes[15].samples.points for shapes in seeds]
    assert torch.equal(points[0], points[1])
    assert not torch.equal(points[0], points[2])


@pytest.mark.parametrize(
    ("labels", "said"),
    [
        ([1], r"no voxel has the label 1; voxels has 5 labels, from 3 to 15"),
        ("some", r'labels must be "all" or whole numbers'),
        ([1.5], r'labels must be "all" or whole numbers'),
    ],
)
def test_wrong_labels_are_refused(volume: np.ndarray, labels: object, said: str) -> None:
    with pytest.raises(tk.InputError, match=said):
        tk.from_labels(volume, labels)  # type: ignore[arg-type]


def test_negative_labels_are_solids_only_where_they_are_named() -> None:
    volume = np.zeros((5, 5, 7), dtype=int)
    volume[1:4, 1:4, 1:6], volume[2, 2, 1:6] = 7, -1
    assert [*tk.from_labels(volume)] == [7]
    assert tk.from_labels(volume, [-1])[-1].genus() == 0


def test_curvature_of_labels_chooses_its_neighbors_as_that_of_volumes_does() -> None:
    volume = np.zeros((8, 8, 8), dtype=int)
    volume[2:6, 2:6, 2:6] = 3
    assert tk.from_labels(volume)[3].n_neighbors is tk.from_voxels(volume, label=3).n_neighbors is None


def test_a_volume_without_labels_is_refused() -> None:
    for empty in (np.zeros((3, 3, 3)), -np.ones((3, 3, 3))):
        with pytest.raises(tk.InputError, match="has no label above 0"):
            tk.from_labels(empty)
    with pytest.raises(tk.InputError, match="origin must be three numbers"):
        tk.from_labels(np.ones((3, 3, 3)), origin=(1, 2))  # type: ignore[arg-type]
