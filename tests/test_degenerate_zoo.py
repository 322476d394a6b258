"""The degenerate zoo through every question: finite values and gradients or a clear refusal, never nonsense."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from zoo import ZOO, sphere

import topokit as tk
from topokit.core.mesh.solid_by_winding import enclosed_solid
from topokit.losses import WindingLoss

SIZES = [60, pytest.param(2000, marks=pytest.mark.long)]
# Single precision rounds and overflows first; halves are widened to it before anything is computed.
OTHERS = (torch.float64, torch.float16, torch.bfloat16)
TYPES = [torch.float32, *(pytest.param(dtype, marks=pytest.mark.long) for dtype in OTHERS)]


def has_nan_gradient(*tensors: Tensor) -> bool:
    """Whether a gradient is NaN, or infinite although its type is wide: of halves, large ones overflow rightly."""
    gradients = [one.grad for one in tensors if one.grad is not None]
    return any(
        bool(grad.isnan().any()) or (grad.dtype.itemsize > 2 and not bool(grad.isfinite().all())) for grad in gradients
    )


def size_of(points: Tensor) -> Tensor:
    """The largest extent, or 1 for points in one place."""
    extent = (points.amax(0) - points.amin(0)).max().detach()
    return torch.where(extent > 0, extent, 1.0)


def numbers_without_unit(shape: tk.Shape) -> Tensor:
    """All of curvature in units of the shape's own size, with a gradient."""
    local, size = shape.curvature(12), size_of(shape.samples.points)
    parts = (local.gaussian * local.area, local.total * local.area, local.mean * size, local.area / size / size)
    return torch.stack((*(part.sum() for part in parts), (local.principal * size).sum(), local.directions.sum()))


DIFFERENTIABLE: dict[str, Callable[[tk.Shape], Tensor]] = {
    "euler": lambda shape: shape.gauss_bonnet(12),
    "refined_euler": lambda shape: shape.refined_euler(2.0, 12, max_steps=2),
    "curvature": numbers_without_unit,
}


@pytest.mark.parametrize("n_points", SIZES)
@pytest.mark.parametrize("dtype", TYPES, ids=str)
@pytest.mark.parametrize("name", ZOO)
def test_values_and_gradients_are_finite_or_refused(name: str, dtype: torch.dtype, n_points: int) -> None:
    """One backward pass serves all questions: a NaN in the gradient of any is one in that of their sum."""
    refusals = []
    for with_normals in (False, True):
        points = ZOO[name](n_points).to(dtype).requires_grad_()
        normals = torch.ones_like(points).requires_grad_() if with_normals else None
        values = []
        try:
            shape = tk.from_points(points, normals)
        except tk.InputError as refusal:
            refusals.append(str(refusal))
            continue
        for question, ask in DIFFERENTIABLE.items():
            try:
                value = ask(shape)
            except tk.InputError as refusal:
                refusals.append(str(refusal))
                continue
            assert value.isfinite().all(), (question, with_normals)
            values.append(value.sum())
        sum(values, torch.zeros((), requires_grad=True)).backward()
        assert not has_nan_gradient(points, *([] if normals is None else [normals])), with_normals
    assert min(map(len, refusals), default=99) > 30


def winding(shape: tk.Shape) -> None:
    points = shape.samples.points.detach().clone().requires_grad_()
    normals = torch.nn.functional.normalize(points.detach() - points.detach().mean(0), dim=1).requires_grad_()
    WindingLoss()(points, normals).backward()
    assert not has_nan_gradient(points, normals)


def moved(shape: tk.Shape) -> None:
    assert shape.regularized().samples.points.isfinite().all()


def turned(shape: tk.Shape) -> None:
    normals = shape.oriented().samples.normals
    assert normals is not None
    assert normals.isfinite().all()


QUESTIONS: dict[str, Callable[[tk.Shape, Path], Any]] = {
    "report": lambda shape, _: shape.report(details=True, locate=True).to_json(),
    "genus": lambda shape, _: shape.genus(),
    "euler": lambda shape, _: shape.euler(),
    "oriented": lambda shape, _: turned(shape),
    "regularized": lambda shape, _: moved(shape),
    "downsample": lambda shape, _: [shape.downsample(100, by=by) for by in ("feature-size", "curvature", "even")],
    "boundaries": lambda shape, _: shape.boundaries(),
    "defects": lambda shape, _: shape.defects(),
    "surface": lambda shape, _: shape.surface(),
    "handles": lambda shape, _: shape.handles(),
    "refined_euler": lambda shape, _: shape.refined_euler(),
    "smoothed_euler": lambda shape, _: shape.smoothed_euler(),
    "to": lambda shape, _: shape.to(torch.float64).gauss_bonnet(),
    "picture": lambda shape, _: shape.picture(),
    "save_ply": lambda shape, folder: shape.save_ply(folder / "out.ply"),
    "save_html": lambda shape, folder: shape.save_html(folder / "out.html"),
    "WindingLoss": lambda shape, _: winding(shape),
}
FAST = ("one place", "NaN island", "1e-30")


@pytest.mark.parametrize("dtype", [torch.float32, pytest.param(torch.float64, marks=pytest.mark.long)], ids=str)
@pytest.mark.parametrize("name", [pytest.param(one, marks=() if one in FAST else pytest.mark.long) for one in ZOO])
def test_every_question_is_answered_or_refused(name: str, dtype: torch.dtype, tmp_path: Path) -> None:
    """Whatever is raised that is no `TopokitError` ends the test."""
    try:
        shape = tk.from_points(ZOO[name](250 if name in FAST else 1000).to(dtype))
    except tk.InputError:
        return
    refusals = []
    for ask in QUESTIONS.values():
        try:
            ask(shape, tmp_path)
        except tk.TopokitError as refusal:
            refusals.append(str(refusal))
    assert min(map(len, refusals)) > 20  # defects() is one of meshes, smoothed_euler() one of fields
    assert shape.report().verdict in ("likely", "unsure")


@pytest.mark.parametrize("value", [torch.nan, torch.inf, 1e30])
def test_a_bad_item_of_a_batch_is_refused_by_name_and_does_not_spoil_the_others(value: float) -> None:
    batch = torch.stack([sphere(200)] * 3).float()
    batch[1, 7, 2] = value
    with pytest.raises(tk.InputError, match=r"NaN or infinite|whose squares leave"):
        tk.from_points(batch)
    good = torch.stack((batch[0], torch.ones(200, 3), batch[2])).requires_grad_()
    estimates = tk.from_points(good).gauss_bonnet()
    alone = tk.from_points(batch[0]).gauss_bonnet()
    assert float(estimates[0].detach()) == pytest.approx(float(alone), abs=1e-5)
    estimates.sum().backward()
    assert not has_nan_gradient(good)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(exponent=st.integers(-120, 120), double=st.booleans())
def test_the_unit_of_length_does_not_matter_or_is_refused(exponent: int, double: bool) -> None:
    """By a power of two, so that every operation is exact: χ is the same number."""
    points = sphere(60) if double else sphere(60).float()
    if not double and abs(exponent) > 65:
        with pytest.raises(tk.InputError, match="float64"):
            tk.from_points(points * 2.0**exponent)
        return
    if not double and abs(exponent) > 55:  # where squares begin to leave the type
        return
    estimate = tk.from_points(points * 2.0**exponent).gauss_bonnet(8)
    assert float(estimate) == pytest.approx(float(tk.from_points(points).gauss_bonnet(8)), rel=1e-9 if double else 1e-4)


@pytest.mark.parametrize("scale", [1e-300, 1e-100, 1e-30, 1e30, 1e100, 1e300])
def test_a_mesh_is_counted_in_any_unit(scale: float) -> None:
    vertices, faces = tk.testing.torus_mesh(12, 8)
    assert str(tk.from_mesh(vertices * scale, faces).report()).startswith("mesh: Euler characteristic 0 (certain)")


@pytest.mark.parametrize("scale", [1e-100, 1e-30, 1e30, 1e100])
def test_the_solid_in_a_mesh_is_found_in_any_unit(scale: float) -> None:
    vertices, faces = tk.testing.torus_mesh(12, 8)
    solid = enclosed_solid(torch.from_numpy(vertices * scale), torch.from_numpy(faces))
    plain = enclosed_solid(torch.from_numpy(vertices), torch.from_numpy(faces))
    assert (solid.euler, solid.off_level) == (plain.euler, pytest.approx(plain.off_level, abs=1e-3))
    assert solid.cell == pytest.approx(plain.cell * scale)


def test_degenerate_triangles_leave_finite_gradients() -> None:
    vertices, faces = tk.testing.icosphere(1)
    collapsed = torch.as_tensor(vertices, dtype=torch.float32).clone()
    collapsed[faces[0, 1]] = collapsed[faces[0, 0]]
    sliver = torch.tensor([[0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=torch.float32)
    points = torch.cat((collapsed, sliver)).requires_grad_()
    n = len(collapsed)
    shape = tk.from_mesh(points, [*faces.tolist(), [n, n + 1, n + 2]], n_samples=200)
    shape.gauss_bonnet().backward()
    assert points.grad is not None
    assert points.grad.isfinite().all()
