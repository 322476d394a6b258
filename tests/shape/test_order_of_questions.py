"""A shape's answers depend on neither the order of questions nor, for the report, the number of neighbors."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import topokit as tk
from topokit.testing import genus_mesh, icosphere, sphere_samples, torus_samples


def half_sphere() -> tk.Shape:
    points = sphere_samples(600).points
    return tk.from_points(points[points[:, 2] > 0])


def a_batch() -> tk.Shape:
    return tk.from_points(torch.stack((sphere_samples(400).points, torus_samples(400).points)))


SHAPES: dict[str, Callable[[], tk.Shape]] = {
    "oriented sphere": lambda: tk.from_points(sphere_samples(400).points, sphere_samples(400).normals),
    "unoriented torus": lambda: tk.from_points(torus_samples(500).points),
    "half sphere": half_sphere,
    "batch": a_batch,
    "mesh": lambda: tk.from_mesh(genus_mesh(2), n_samples=600),
    "open mesh": lambda: tk.from_mesh((icosphere(2)[0], icosphere(2)[1][:-5]), n_samples=600),
    "volume": lambda: tk.from_voxels(torch.ones(5, 6, 7, dtype=torch.bool), n_samples=300),
    "function": lambda: tk.from_sdf(lambda p: p.norm(dim=-1) - 0.6, resolution=128, n_samples=300, field_resolution=16),
}
QUESTIONS: dict[str, Callable[[tk.Shape], Any]] = {
    "integer": lambda shape: shape.euler(),
    "euler": lambda shape: shape.gauss_bonnet(),
    "euler of few neighbors": lambda shape: shape.gauss_bonnet(5),
    "euler of many neighbors": lambda shape: shape.gauss_bonnet(40, solver="symmetrized"),
    "euler by Monte Carlo": lambda shape: shape.gauss_bonnet(12, area_method="monte-carlo", area_resolution=8),
    "curvature": lambda shape: shape.curvature().gaussian,
    "curvature of few neighbors": lambda shape: shape.curvature(7, solver="commuting").mean,
    "refined": lambda shape: shape.refined_euler(max_steps=2),
    "refined to a target": lambda shape: shape.refined_euler(2.0, 10, max_steps=1, over=("normals", "areas")),
    "field": lambda shape: shape.smoothed_euler(),
    "genus": lambda shape: shape.genus(),
    "report": lambda shape: without_times(shape.report()),
    "oriented": lambda shape: shape.oriented().samples.known_normals(),
    "samples": lambda shape: shape.samples.points,
    "double": lambda shape: shape.to(torch.float64).gauss_bonnet(9),
    "name": lambda shape: shape.replace(name="other", n_neighbors=6).gauss_bonnet(),
    "text": lambda shape: str(shape.replace(name="other")).partition(",")[0],
}


def without_times(report: tk.TopologyReport) -> str:
    rows = report.to_dict()
    rows["evidence"] = [{**row, "seconds": 0} for row in rows["evidence"]]
    return json.dumps(rows)


def ask(shape: tk.Shape, question: str) -> Any:
    """The answer, or the class and message of the error."""
    try:
        return QUESTIONS[question](shape)
    except tk.TopokitError as error:
        return type(error).__name__, str(error)


@cache
def fresh_answer(name: str, question: str) -> Any:
    return ask(SHAPES[name](), question)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, Tensor):
        return isinstance(other, Tensor) and torch.equal(one, other)
    return bool(one == other)


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=3, deadline=None, derandomize=True)
@given(questions=st.lists(st.sampled_from(sorted(QUESTIONS)), min_size=2, max_size=7))
def test_any_order_gives_the_answers_of_fresh_shapes(name: str, questions: list[str]) -> None:
    shape = SHAPES[name]()
    for question in questions:
        assert same(ask(shape, question), fresh_answer(name, question)), (name, question, questions)


@pytest.mark.parametrize("samples", [sphere_samples, torus_samples], ids=["sphere", "torus"])
@pytest.mark.parametrize(
    ("n_points", "others"),
    [
        (300, (4, 6, 12, 60)),
        pytest.param(1000, (4, 12, 60), marks=pytest.mark.long),
        pytest.param(5000, (60,), marks=pytest.mark.long),
    ],
)
def test_the_report_of_a_closed_cloud_ignores_the_number_of_neighbors(
    samples: Callable[[int], Any], n_points: int, others: tuple[int, ...]
) -> None:
    points = samples(n_points).points
    plain = tk.from_points(points).report()
    assert (plain.euler, plain.closed) == (2 if samples is sphere_samples else 0, True)
    for k in others:
        assert without_times(tk.from_points(points, n_neighbors=k).report()) == without_times(plain), k


def test_a_change_in_place_is_seen() -> None:
    points = sphere_samples(500).points.clone()
    shape = tk.from_points(points)
    before = float(shape.gauss_bonnet())
    points *= torch.tensor([1.0, 1.0, 0.5])
    assert float(shape.gauss_bonnet()) == float(tk.from_points(points).gauss_bonnet()) != before


def test_tensors_of_inference_mode_are_measured() -> None:
    points = sphere_samples(300).points
    with torch.inference_mode():
        shape = tk.from_points(points.clone())
        value = float(shape.gauss_bonnet())
    assert value == float(shape.gauss_bonnet()) == float(tk.from_points(points).gauss_bonnet())
    moving = tk.from_points(points.clone().requires_grad_())
    with torch.inference_mode():
        moving.gauss_bonnet()
    moving.gauss_bonnet().backward()
    assert moving.samples.points.grad is not None


def test_shapes_are_immutable() -> None:
    shape = tk.from_points(sphere_samples(100).points)
    with pytest.raises(AttributeError, match=r"shape.replace\(name="):
        shape.name = "other"
    with pytest.raises(tk.TopokitError, match="samples cannot be replaced"):
        shape.replace(samples=None)
    assert (shape.replace(name="other").name, shape.name) == ("other", "points")
