"""Calls of functions: how many points at a time, memory that does not suffice, NaN, devices, values of another kind."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

import topokit as tk
from topokit.adapters.implicit.function import LevelFunction, _candidates
from topokit.testing import as_on_accelerator

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
ROUGH: dict[str, Any] = {"bounds": BOX, "resolution": 128, "n_samples": 2000, "field_resolution": 32}


def torus(x: Tensor) -> Tensor:
    return torch.hypot(x[:, :2].norm(dim=1) - 0.6, x[:, 2]) - 0.25


class Limited:
    """A torus that can take so many points; counts those of each call."""

    def __init__(self, most: int = 1 << 20, error: type[Exception] = MemoryError, said: str = "") -> None:
        self.most, self.error, self.said = most, error, said
        self.sizes: list[int] = []

    def __call__(self, x: Tensor) -> Tensor:
        self.sizes.append(len(x))
        if len(x) > self.most:
            raise self.error(self.said)
        return torus(x)


def test_no_call_has_more_points_than_the_batch_size_and_no_answer_depends_on_it() -> None:
    one, other = Limited(), Limited()
    whole, batches = tk.from_sdf(one, **ROUGH), tk.from_sdf(other, batch_size=7000, **ROUGH)
    expected, found = whole.report(), batches.report()
    assert (found.euler, found.verdict, found.per_component) == (0, "likely", expected.per_component)
    torch.testing.assert_close(batches.samples.points, whole.samples.points)
    torch.testing.assert_close(batches.smoothed_euler(0.1), whole.smoothed_euler(0.1))
    assert max(other.sizes) == 7000 < max(one.sizes)
    assert sum(other.sizes) == sum(one.sizes)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError, ""),
        (torch.OutOfMemoryError, "CUDA out of memory. Tried to allocate 6.10 GiB."),
        (RuntimeError, "[enforce fail at alloc_cpu.cpp:114] . DefaultCPUAllocator: can't allocate memory"),
        (RuntimeError, "[enforce fail at alloc_cpu.cpp:80] data. DefaultCPUAllocator: not enough memory"),
        (RuntimeError, "MPS backend out of memory (MPS allocated: 8.87 GB)"),
    ],
)
def test_batches_are_halved_where_memory_does_not_suffice(error: type[Exception], said: str) -> None:
    f = Limited(5000, error, said)
    function = LevelFunction(f, 0.1, -1, "f", torch.zeros(5, 3))
    points = torch.rand(70_000, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(function.without_graph(points), 0.1 - torus(points))
    assert f.sizes[:6] == [5, 65536, 32768, 16384, 8192, 4096]
    assert set(f.sizes[6:-1]) == {4096}
    values, gradient = function.value_and_gradient(points[:9000])
    assert f.sizes[-3:] == [4096, 4096, 9000 - 2 * 4096]
    torch.testing.assert_close(values, 0.1 - torus(points[:9000]))
    assert gradient.shape == (9000, 3)
    assert function.n_evaluations == 79_000


def test_a_point_that_needs_too_much_memory_is_an_error_and_other_failures_are_the_callers() -> None:
    points = torch.zeros(100, 3)
    function = LevelFunction(torus, 0.0, -1, "f", points[:5])
    function.f = Limited(0, torch.OutOfMemoryError, "CUDA out of memory.")
    with pytest.raises(tk.InputError, match=r"runs out of memory.*CUDA out of memory.*n_samples"):
        function(points)
    function.f = Limited(0, RuntimeError, "mat1 and mat2 shapes cannot be multiplied")
    with pytest.raises(RuntimeError, match="mat1 and mat2"):
        function(points)
    assert function.f.sizes == [100]


def test_nan_is_refused_on_accelerators_too() -> None:
    def broken(x: Tensor) -> Tensor:  # NaN in 40 % of the box
        return torus(x) + 0 * (0.2 - x[:, 0]).sqrt()

    with as_on_accelerator():
        for ask in (tk.Shape.report, tk.Shape.gauss_bonnet, tk.Shape.surface):
            with pytest.raises(tk.InputError, match="is NaN at"):
                ask(tk.from_sdf(broken, **ROUGH))
        with pytest.raises(tk.InputError, match="is NaN at"):
            tk.from_sdf(broken)
        followed = tk.from_sdf(broken, starts=torch.tensor([[0.84, 0.0, 0.0], [-0.84, 0.0, 0.0]]), **ROUGH)
        with pytest.raises(tk.InputError, match="is NaN at 1 of 2 points"):
            followed.samples  # noqa: B018
        assert tk.from_sdf(broken, **ROUGH).field.values().isnan().any()  # without a look at the device


def test_a_function_that_leaves_torch_is_told_what_to_do() -> None:
    shape = tk.from_sdf(lambda x: torch.from_numpy(torus(x).numpy()), **ROUGH)
    assert shape.report().euler == 0
    for ask in (tk.Shape.curvature, tk.Shape.gauss_bonnet):
        with pytest.raises(tk.InputError, match=r"leaves torch.*\.detach\(\)\.cpu\(\)\.numpy\(\)"):
            ask(shape)
    detached = tk.from_sdf(lambda x: torch.from_numpy(torus(x.detach()).numpy()), **ROUGH)
    assert abs(float(detached.gauss_bonnet(boundary=False))) < 0.5


@pytest.mark.parametrize("scale", [1.0, -50.0])
@pytest.mark.parametrize("bounds", [BOX, None])
def test_values_that_are_no_probabilities_are_refused_early(scale: float, bounds: Any) -> None:
    f = Limited()
    shape = tk.from_occupancy(lambda x: scale * f(x), **{**ROUGH, "bounds": bounds})
    with pytest.raises(tk.InputError, match=r"no probabilities.* from_sdf .*logits=True"):
        shape.report()
    assert sum(f.sizes) < 600_000


def test_ripples_around_zero_and_other_levels_are_taken() -> None:
    def fitted(x: Tensor) -> Tensor:
        return torch.sigmoid(-20 * torus(x)) - 0.05

    assert tk.from_occupancy(fitted, **ROUGH).report().euler == 0
    assert tk.from_occupancy(lambda x: -torus(x), level=0.0, **ROUGH).report().euler == 0
    assert tk.from_occupancy(lambda x: -20 * torus(x), logits=True, **ROUGH).report().euler == 0


def test_plain_functions_are_tried_on_every_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    devices = [str(device) for _, device in _candidates(torus)]
    assert devices[::3] == ["cpu", "cuda", "cuda:0", "cuda:1"]
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    assert {str(device) for _, device in _candidates(torus)} == {"cpu"}
