"""Topology of fields on grids against scikit-image, gudhi's cubical complex, the definitions and brute force."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from skimage.measure import euler_number

from topokit.core.grid import euler as grid_euler
from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.euler import critical_index, dual_connectivity, smoothed_euler, solid_euler, surface_euler
from topokit.errors import InputError

CONNECTIVITIES = (6, 26)
DEVICES = ["cpu"] + (["cuda"] if torch.cuda.is_available() else [])

connectivities = st.sampled_from(CONNECTIVITIES)
volumes = arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=6))
ties = arrays(np.int8, array_shapes(min_dims=3, max_dims=3, max_side=5), elements=st.integers(-3, 3))


def skimage_euler(mask: Any, connectivity: int) -> int:
    return euler_number(np.asarray(mask), {6: 1, 26: 3}[connectivity])


def gudhi_complex(field: Any, connectivity: int) -> Any:
    """gudhi filters by sublevels: vertices carry the values for 6, top-dimensional cells for 26."""
    gudhi = pytest.importorskip("gudhi")
    values = -np.asarray(field, dtype=float)
    return gudhi.CubicalComplex(**{{6: "vertices", 26: "top_dimensional_cells"}[connectivity]: values})


def gudhi_betti(field: Any, level: float, connectivity: int) -> list[int]:
    complex_ = gudhi_complex(field, connectivity)
    complex_.compute_persistence(min_persistence=-1.0)
    betti = [0, 0, 0]
    for dim in range(3):
        for birth, death in complex_.persistence_intervals_in_dimension(dim):
            betti[dim] += birth < -level <= death
    return betti


def smoothed_by_cells(field: torch.Tensor, tau: float, connectivity: int) -> torch.Tensor:
    """The definition: eight shifted extremes, each through a sigmoid."""
    if connectivity == 26:
        field = torch.nn.functional.pad(field, (1,) * 6, value=-torch.inf)
    total = 0.0
    for axes in itertools.chain.from_iterable(itertools.combinations((-3, -2, -1), r) for r in range(4)):
        cells = field
        for axis in axes:
            n = cells.shape[axis] - 1
            extreme = torch.minimum if connectivity == 6 else torch.maximum
            cells = extreme(cells.narrow(axis, 0, n), cells.narrow(axis, 1, n))
        dim = len(axes) if connectivity == 6 else 3 - len(axes)
        total = total + (-1) ** dim * torch.sigmoid(cells / tau).sum((-3, -2, -1))
    return 2 * total


def ball(n: int, radius: float, center: tuple[float, float, float] | None = None) -> torch.Tensor:
    axes = torch.meshgrid(*[torch.arange(n, dtype=torch.float64)] * 3, indexing="ij")
    center = center or ((n - 1) / 2,) * 3
    return radius - sum((a - c) ** 2 for a, c in zip(axes, center, strict=True)).sqrt()


def torus(n: int = 32, major: float = 9.0, minor: float | torch.Tensor = 4.0) -> torch.Tensor:
    x, y, z = (a - (n - 1) / 2 for a in torch.meshgrid(*[torch.arange(n, dtype=torch.float64)] * 3, indexing="ij"))
    return minor - ((torch.hypot(x, y) - major) ** 2 + z**2).sqrt()


@given(volumes, connectivities)
@settings(max_examples=100, deadline=None)
def test_solid_euler_equals_skimage(mask: np.ndarray, connectivity: int) -> None:
    expected = skimage_euler(mask, connectivity)
    assert (solid_euler(mask, 0, connectivity), surface_euler(mask, 0, connectivity)) == (expected, 2 * expected)


@given(volumes, connectivities)
@settings(max_examples=60, deadline=None)
def test_betti_numbers_equal_gudhi(mask: np.ndarray, connectivity: int) -> None:
    assert betti_numbers(mask, 0.5, connectivity).tolist() == gudhi_betti(mask, 0.5, connectivity)


@given(ties, connectivities, st.integers(-4, 3))
@settings(max_examples=60, deadline=None)
def test_grey_levels_equal_gudhi(field: np.ndarray, connectivity: int, level: int) -> None:
    betti = gudhi_betti(field, level + 0.5, connectivity)
    assert betti_numbers(field, level, connectivity).tolist() == betti
    assert solid_euler(field, level, connectivity) == betti[0] - betti[1] + betti[2]


@given(volumes)
@settings(max_examples=60, deadline=None)
def test_duality(mask: np.ndarray) -> None:
    assert (dual_connectivity(6), dual_connectivity(26)) == (26, 6)
    assert solid_euler(mask, connectivity=26) == solid_euler(~np.pad(mask, 1), connectivity=6) - 1


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
@pytest.mark.parametrize("shape", [(300, 5, 4), (40, 33, 21), (1, 1, 1), (1, 9, 2)])
def test_slabs_do_not_show(monkeypatch: pytest.MonkeyPatch, shape: tuple[int, ...], connectivity: int) -> None:
    torch.manual_seed(0)
    mask = torch.rand(shape) < 0.5
    monkeypatch.setattr(grid_euler, "_SLAB", 1 << 40)
    whole = critical_index(mask, connectivity)
    monkeypatch.setattr(grid_euler, "_SLAB", 1)
    monkeypatch.setattr(grid_euler, "_COUNT_SLAB", 1)
    assert torch.equal(critical_index(mask, connectivity), whole)
    assert solid_euler(mask, connectivity=connectivity) == skimage_euler(mask, connectivity)


def test_more_than_255_layers_of_ones() -> None:
    assert solid_euler(torch.ones(700, 3, 3, dtype=torch.uint8)) == 1


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    "dtype",
    ["bool", "uint8", "int8", "uint16", "int16", "uint32", "int64", "float16", "bfloat16", "float32", "float64"],
)
def test_dtypes_devices_batches_and_layouts(dtype: str, device: str, connectivity: int) -> None:
    torch.manual_seed(1)
    gray = torch.randint(0, 4, (2, 3, 9, 8, 7))
    level = 0 if dtype == "bool" else 1.5
    expected = [[skimage_euler(volume > level, connectivity) for volume in row] for row in gray]
    field = gray.to(getattr(torch, dtype)).to(device)
    answer = solid_euler(field, level, connectivity)
    assert answer.device == field.device
    assert answer.tolist() == expected
    b0, b1, b2 = betti_numbers(field, level, connectivity).unbind(-1)
    assert (b0 - b1 + b2).tolist() == expected
    index = critical_index(field, connectivity)
    assert ((gray.to(device) > level) * index.long()).sum((-3, -2, -1)).tolist() == expected
    strided = field.movedim(-1, -3).contiguous().movedim(-3, -1)
    assert torch.equal(solid_euler(strided, level, connectivity), answer)
    assert torch.equal(critical_index(strided, connectivity), index)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_no_step_needs_the_values_on_the_host(connectivity: int) -> None:
    field = torch.randn(2, 30, 30, 30, device="meta")
    assert solid_euler(field, 0.0, connectivity).shape == (2,)
    assert smoothed_euler(field, 0.1, 0.0, connectivity).shape == (2,)


@given(ties, connectivities)
@settings(max_examples=60, deadline=None)
def test_index_counts_every_level(field: np.ndarray, connectivity: int) -> None:
    index = critical_index(field, connectivity).long()
    for level in range(-4, 4):
        assert (index * (torch.as_tensor(field) > level)).sum() == skimage_euler(field > level, connectivity)


@given(ties)
@settings(max_examples=60, deadline=None)
def test_ties_are_broken_by_position(field: np.ndarray) -> None:
    voxels = np.arange(field.size)
    for connectivity, position in ((6, voxels), (26, -voxels)):
        order = np.lexsort((position, field.ravel()))
        ranks = np.empty(field.size, dtype=np.int64)
        ranks[order] = voxels
        untied = critical_index(ranks.reshape(field.shape), connectivity)
        assert torch.equal(critical_index(field, connectivity), untied)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_index_of_smooth_fields(connectivity: int) -> None:
    assert critical_index(ball(16, 5.0, (7.1, 7.2, 7.3)), connectivity).count_nonzero() == 1
    assert critical_index(torch.zeros(9, 8, 7), connectivity).count_nonzero() == 1


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_nan_and_infinity(connectivity: int) -> None:
    field = torch.tensor([1.0, torch.nan, torch.inf, -torch.inf]).reshape(4, 1, 1)
    assert solid_euler(field, 0.0, connectivity) == 2


@pytest.mark.parametrize("shape", [(0, 3, 3), (3, 0, 3), (3, 3, 0), (0, 3, 3, 3), (2, 3, 0, 3)])
@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_empty_grids(shape: tuple[int, ...], connectivity: int) -> None:
    field = torch.zeros(shape)
    assert not solid_euler(field, 0.0, connectivity).any()
    assert not betti_numbers(field, 0.0, connectivity).any()
    assert smoothed_euler(field, 0.1, 0.0, connectivity).shape == shape[:-3]


@pytest.mark.parametrize(
    "call",
    [
        lambda: solid_euler(torch.zeros(3, 3)),
        lambda: solid_euler(torch.zeros(3, 3, 3), connectivity=18),
        lambda: betti_numbers(torch.zeros(3, 3)),
        lambda: critical_index(torch.zeros(3)),
        lambda: smoothed_euler(torch.zeros(3, 3, 3), tau=0.0),
        lambda: smoothed_euler(torch.zeros(3, 3, 3), tau=float("nan")),
        lambda: smoothed_euler(torch.zeros(3, 3), tau=1.0),
    ],
)
def test_unusable_input_is_refused(call: Callable[[], object]) -> None:
    with pytest.raises(InputError, match=r"shape|connectivity|tau"):
        call()


def test_smoothed_needs_floats() -> None:
    for field in (torch.zeros(3, 3, 3, dtype=torch.uint8), np.zeros((3, 3, 3))):
        with pytest.raises(InputError, match="floating-point"):
            smoothed_euler(field, 1.0)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_known_solids(connectivity: int) -> None:
    hollow = torch.minimum(ball(24, 9.0), -ball(24, 5.0))
    assert betti_numbers(torus(), 0.0, connectivity).tolist() == [1, 1, 0]
    assert betti_numbers(hollow, 0.0, connectivity).tolist() == [1, 0, 1]
    assert betti_numbers(torch.maximum(hollow, ball(24, 2.0)), 0.0, connectivity).tolist() == [2, 0, 1]


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
@pytest.mark.parametrize("tau", [1e-6, 1e-2, 0.3, 2.0, 1e3])
def test_smoothed_is_its_definition_and_the_mean_over_levels(tau: float, connectivity: int) -> None:
    torch.manual_seed(2)
    field = torch.randn(6, 7, 5, dtype=torch.float64)
    value = smoothed_euler(field, tau, 0.0, connectivity)
    torch.testing.assert_close(value, smoothed_by_cells(field, tau, connectivity), atol=1e-10, rtol=0)
    # {field > t} only changes when t passes a value, so the mean over t ~ Logistic(0, tau) is a finite sum
    values = field.flatten().sort().values
    below = torch.cat((torch.zeros(1, dtype=torch.float64), torch.sigmoid(values / tau)))
    probabilities = torch.cat((below, torch.ones(1, dtype=torch.float64))).diff()[1:]
    surface = [2 * skimage_euler(field.numpy() > t, connectivity) for t in values.tolist()]
    mean = (
        2 * skimage_euler(np.ones(field.shape), connectivity) * below[1]
        + probabilities @ torch.tensor(surface).double()
    )
    torch.testing.assert_close(value, mean, atol=1e-10, rtol=0)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
@pytest.mark.parametrize("device", DEVICES)
def test_small_tau_gives_the_integer(dtype: torch.dtype, connectivity: int, device: str) -> None:
    torch.manual_seed(3)
    field = torch.randn(2, 20, 19, 18).to(dtype)
    field = torch.where(field.abs() < 1e-2, torch.ones((), dtype=dtype), field).to(device)
    for level in (0.0, -0.0078125):
        field = torch.where(field == level, field + 1, field)
        smoothed = smoothed_euler(field, 1e-6, level, connectivity)
        assert smoothed.tolist() == (2 * solid_euler(field, level, connectivity)).tolist()


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_gradcheck(connectivity: int) -> None:
    torch.manual_seed(4)
    field = torch.randn(2, 3, 4, 3, dtype=torch.float64, requires_grad=True)
    tau = torch.tensor([0.3, 0.7], dtype=torch.float64, requires_grad=True)
    function = lambda f, t: smoothed_euler(f, t, 0.1, connectivity)  # noqa: E731
    assert torch.autograd.gradcheck(function, (field, tau), check_forward_ad=True)
    assert torch.autograd.gradgradcheck(function, (field, tau))


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_gradient_is_that_of_the_definition(monkeypatch: pytest.MonkeyPatch, connectivity: int) -> None:
    torch.manual_seed(5)
    field = torch.randn(37, 8, 9, dtype=torch.float64, requires_grad=True)
    monkeypatch.setattr(grid_euler, "_SLAB", 1)
    (ours,) = torch.autograd.grad(smoothed_euler(field, 0.2, 0.0, connectivity), field)
    (theirs,) = torch.autograd.grad(smoothed_by_cells(field, 0.2, connectivity), field)
    torch.testing.assert_close(ours, theirs)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_a_batch_equals_its_items(connectivity: int) -> None:
    torch.manual_seed(6)
    field = torch.randn(2, 3, 8, 7, 6, dtype=torch.float64, requires_grad=True)
    batch = smoothed_euler(field, 0.2, 0.0, connectivity)
    (gradient,) = torch.autograd.grad(batch.sum(), field)
    for i, j in np.ndindex(2, 3):
        item = field[i, j].detach().requires_grad_()
        single = smoothed_euler(item, 0.2, 0.0, connectivity)
        torch.testing.assert_close(single, batch[i, j])
        torch.testing.assert_close(torch.autograd.grad(single, item)[0], gradient[i, j])


INFINITE = torch.tensor([torch.inf, -torch.inf, 0.0, 1.0])


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
@pytest.mark.parametrize("tau", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
@pytest.mark.parametrize(
    "field",
    [
        torch.zeros(4, 5, 6),
        torch.full((3, 3, 3), 1e4),
        torch.full((3, 3, 3), torch.inf),
        torch.full((3, 3, 3), -torch.inf),
        torch.zeros(1, 1, 1),
        torch.zeros(1, 4, 1),
        INFINITE[torch.arange(60) * 7 % 4].reshape(3, 4, 5),
        torch.arange(60).remainder(3).sub(1).float().reshape(3, 4, 5),
    ],
    ids=["constant", "large", "inf", "-inf", "one-voxel", "line", "mixed-inf", "ties"],
)
def test_never_nan(field: torch.Tensor, dtype: torch.dtype, tau: float, connectivity: int) -> None:
    field = field.clone().to(dtype).requires_grad_()
    value = smoothed_euler(field, tau, 0.0, connectivity)
    value.backward()
    expected = smoothed_by_cells(field.detach().double(), tau, connectivity)
    torch.testing.assert_close(value.detach().double(), expected, atol=1e-4, rtol=0)
    assert not field.grad.isnan().any()
    assert dtype == torch.float16 or field.grad.isfinite().all()


def test_constant_field_moves_one_voxel() -> None:
    field = torch.zeros(4, 5, 6, dtype=torch.float64, requires_grad=True)
    smoothed_euler(field, 1.0).backward()
    assert field.grad.count_nonzero() == 1
    assert field.grad.sum() == 0.5


@pytest.mark.parametrize("backend", ["aot_eager", pytest.param("inductor", marks=pytest.mark.long)])  # a C++ compiler
@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_compiles_without_graph_breaks(connectivity: int, backend: str) -> None:
    torch.manual_seed(7)
    compiled = torch.compile(smoothed_euler, fullgraph=True, backend=backend)
    field = torch.randn(2, 9, 8, 7, requires_grad=True)
    value = compiled(field, 0.1, 0.0, connectivity)
    eager = smoothed_euler(field, 0.1, 0.0, connectivity)
    torch.testing.assert_close(value, eager)
    torch.testing.assert_close(torch.autograd.grad(value.sum(), field), torch.autograd.grad(eager.sum(), field))


def test_descent_closes_the_hole_of_a_torus() -> None:
    radius = torch.tensor(3.0, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([radius], lr=0.1)
    assert betti_numbers(torus(32, 6.0, radius.item())).tolist() == [1, 1, 0]
    for _ in range(60):
        optimizer.zero_grad()
        (smoothed_euler(torus(32, 6.0, radius), 2.0) - 2.0).square().backward()
        optimizer.step()
    assert betti_numbers(torus(32, 6.0, radius.item())).tolist() == [1, 0, 0]
