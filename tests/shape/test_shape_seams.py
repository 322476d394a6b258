"""Shapes in inference mode, without gradients, pickled, deleted from, and asked with arguments that make no sense."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from contextlib import AbstractContextManager

import pytest
import torch
from torch import Tensor

import topokit as tk
from topokit.testing import genus_mesh, torus_samples

MODES = [torch.no_grad, torch.inference_mode]


def mesh_of(vertices: Tensor) -> tk.Shape:
    return tk.from_mesh(vertices, genus_mesh(1)[1], n_samples=400)


@pytest.mark.parametrize("mode", MODES)
def test_a_question_without_gradients_does_not_remove_them(mode: Callable[[], AbstractContextManager[None]]) -> None:
    vertices = torch.from_numpy(genus_mesh(1)[0]).requires_grad_()
    shape = mesh_of(vertices)
    with mode():
        shape.report(details=True)
        shape.curvature()
    shape.gauss_bonnet().backward()
    assert vertices.grad is not None
    assert float(vertices.grad.norm()) > 0


def test_self_optimization_works_in_inference_mode() -> None:
    known = torus_samples(400)
    expected = tk.from_points(known.points, known.normals).refined_euler(0.0)
    with torch.inference_mode():
        shape = tk.from_points(known.points.clone(), known.normals.clone())
        assert torch.equal(shape.refined_euler(0.0), expected)
        assert mesh_of(torch.from_numpy(genus_mesh(1)[0])).report(details=True).refined == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize(
    "shape",
    [
        mesh_of(torch.from_numpy(genus_mesh(1)[0])),
        tk.from_points(torus_samples(300).points),
        tk.from_voxels(torch.ones(4, 4, 4, dtype=torch.bool), n_samples=200),
    ],
    ids=lambda shape: shape.name,
)
def test_shapes_and_reports_are_pickled(shape: tk.Shape) -> None:
    again = pickle.loads(pickle.dumps(shape))
    assert torch.equal(again.gauss_bonnet(), shape.gauss_bonnet())
    report = again.report()
    assert report == shape.report() == pickle.loads(pickle.dumps(report))
    assert json.loads(report.to_json()) == report.to_dict()


def test_numbers_that_are_not_finite_are_null_in_json() -> None:
    volume = torch.ones(3, 3, 3, dtype=torch.bool)
    rows = json.loads(tk.from_voxels(volume, spacing=1e300, origin=(1e308, 0, 0)).report().to_json())
    assert rows["euler"] == 2


def test_coordinates_without_distances_are_refused() -> None:
    with pytest.raises(tk.InputError, match=r"coordinates up to 1\.\d+e\+200, whose squares leave torch.float64"):
        tk.from_points(torus_samples(300).points * 1e200)


@pytest.mark.parametrize("wrong", [20.0, "a", 0, -1, True])
def test_numbers_of_neighbors_are_checked_wherever_they_come_in(wrong: object) -> None:
    points = torus_samples(300).points
    asks: list[Callable[[], object]] = [
        lambda: tk.from_points(points, n_neighbors=wrong),  # type: ignore[arg-type]
        lambda: tk.from_points(points).replace(n_neighbors=wrong),
        lambda: tk.from_points(points).gauss_bonnet(wrong),  # type: ignore[arg-type]
    ]
    for ask in asks:
        with pytest.raises(tk.InputError, match="an integer of at least 3"):
            ask()


def test_resolutions_are_checked_and_attributes_stay() -> None:
    shape = tk.from_points(torus_samples(300).points)
    for wrong in (-1, 0, 1, 1.5):
        with pytest.raises(tk.InputError, match="area_resolution"):
            shape.gauss_bonnet(area_method="monte-carlo", area_resolution=wrong)  # type: ignore[arg-type]
    with pytest.raises(AttributeError, match="immutable"):
        del shape.name
