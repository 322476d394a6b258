"""The nearest solid with given Betti numbers: six kinds of change, noise, ties, and what is out of reach."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from analytic_fields import ball, block, grid, meshed_topology, rod, torus, union, without
from scipy.ndimage import gaussian_filter

from topokit.core.grid.betti import betti_numbers
from topokit.core.homotopy import nearest_solid as module
from topokit.core.homotopy.nearest_solid import cost, nearest_solid

P = grid(28)
TORUS = torus(P, 0.5, 0.25)
DUMBBELL = union(ball(P, 0.32, (-0.5, 0, 0)), ball(P, 0.32, (0.5, 0, 0)), rod(P, 0.12, 0.5, axis=0))
DISC = without(rod(P, 0.7, 0.3), ball(P, 0.6, (0, 0, 0.75)), ball(P, 0.6, (0, 0, -0.75)))
TWO_BALLS = union(ball(P, 0.33, (-0.42, 0, 0)), ball(P, 0.35, (0.42, 0, 0)))
SHELL = without(ball(P, 0.7), ball(P, 0.25, (0.1, 0, 0.1)))
WITH_FLOATER = union(ball(P, 0.5, (-0.2, 0, 0)), ball(P, 0.14, (0.65, 0.3, 0.3)))

CHANGES = {  # field, wanted Betti numbers, how
    "close": (TORUS, (1, 0, 0), "add"),
    "drill": (DISC, (1, 1, 0), "remove"),
    "join": (TWO_BALLS, (1, 0, 0), "add"),
    "join parts of a rod": (without(rod(P, 0.25, 0.8), block(P, (1, 1, 0.1))), (1, 0, 0), "add"),
    "split": (DUMBBELL, (2, 0, 0), "remove"),
    "remove": (WITH_FLOATER, (1, 0, 0), "remove"),
    "remove beside a torus": (union(torus(P, 0.4, 0.2), ball(P, 0.15, (0.75, 0.7, 0.6))), (1, 1, 0), "remove"),
    "fill": (SHELL, (1, 0, 0), "add"),
    "fill a torus": (without(torus(P, 0.5, 0.3), ball(P, 0.14, (0.5, 0, 0))), (1, 1, 0), "add"),
}


def find(
    field: torch.Tensor | np.ndarray, betti: tuple[int, int, int], smooth: bool = True, **options: Any
) -> np.ndarray:
    """The nearest solid, its Betti numbers checked in both connectivities and, if it is smooth, by marching cubes.

    Where voxels meet through an edge only, marching cubes decides face by face and agrees with neither connectivity.
    """
    field = np.asarray(field)
    solid = nearest_solid(field, betti, **options)
    assert solid is not None
    assert solid.dtype == bool
    for connectivity in (options["connectivity"],) if "connectivity" in options else (6, 26):
        assert betti_numbers(solid, connectivity=connectivity).tolist() == list(betti)
    if smooth:
        components, tunnels, cavities = betti
        surfaces = components + cavities
        assert meshed_topology(np.where(solid, 1.0, -1.0)) == (surfaces, 2 * (surfaces - tunnels))
    return solid


@pytest.mark.parametrize("name", CHANGES)
def test_each_kind_of_change_is_found_and_is_small(name: str) -> None:
    field, betti, change = CHANGES[name]
    present = (field > 0).numpy()
    solid = find(field, betti, change=change)
    assert (solid > present).any() if change == "add" else (solid < present).any()
    assert (solid >= present).all() if change == "add" else (solid <= present).all()
    assert (solid != present).sum() <= 0.12 * present.sum()
    assert cost(field.numpy(), find(field, betti)) <= cost(field.numpy(), solid)


@pytest.mark.parametrize("name", CHANGES)
def test_each_kind_of_change_under_noise(name: str, generator: torch.Generator) -> None:
    field, betti, _ = CHANGES[name]
    noise = torch.randn(field.shape, generator=generator, dtype=torch.float64)
    noisy = field + 0.03 * noise
    assert betti_numbers(noisy).tolist() != betti_numbers(field).tolist()
    solid = find(noisy, betti, smooth=False)
    assert (solid != (noisy > 0).numpy()).sum() < 0.25 * (field > 0).sum()


def test_symmetric_fields_are_not_changed_all_at_once() -> None:
    """A ring is equally thick everywhere, and equal parts have equal cost."""
    present = (TORUS > 0).numpy()
    cut = find(TORUS, (1, 0, 0), change="remove")
    assert (cut <= present).all()
    assert 0 < (cut < present).sum() < 0.1 * present.sum()
    four = union(*(ball(P, 0.3, (x, y, 0)) for x, y in ((0.5, 0.1), (-0.5, -0.1), (0.1, -0.5), (-0.1, 0.5))))
    find(four, (3, 0, 0))


def test_the_cheaper_of_raising_and_lowering_the_level_is_chosen() -> None:
    """Two rings become a ball by filling gap and holes, or by breaking both and joining the fragments."""
    links = union(torus(P, 0.3, 0.12, (-0.48, 0, 0)), torus(P, 0.3, 0.12, (0.48, 0, 0))).numpy()
    solid = find(links, (1, 0, 0))
    assert (solid >= (links > 0)).all()
    assert cost(links, solid) < 0.5 * cost(links, find(links, (1, 0, 0), change="remove"))


def test_only_allowed_changes_are_made() -> None:
    """A torus becomes a ball by a membrane in its hole, or by a cut through its tube."""
    present = (TORUS > 0).numpy()
    added, removed = find(TORUS, (1, 0, 0), change="add"), find(TORUS, (1, 0, 0), change="remove")
    assert (added > present).any()
    assert (added >= present).all()
    assert (removed < present).any()
    assert (removed <= present).all()


@pytest.mark.parametrize("change", ["add", "remove"])
def test_noise_is_removed_by_one_way_changes(change: str, generator: torch.Generator) -> None:
    noisy = (ball(P, 0.6) + 0.1 * torch.randn(P.shape[:3], generator=generator, dtype=torch.float64)).numpy()
    solid = find(noisy, (1, 0, 0), smooth=False, change=change)
    assert (solid >= (noisy > 0)).all() if change == "add" else (solid <= (noisy > 0)).all()


def test_details_that_smoothing_removes_are_kept_where_removal_is_not_allowed() -> None:
    speck, pinhole = TORUS.clone(), ball(P, 0.5).clone()
    speck[3, 3, 3], pinhole[14, 14, 14] = 0.02, -0.02
    assert (find(speck, (1, 0, 0), change="add") >= (speck > 0).numpy()).all()
    assert (find(pinhole, (1, 0, 0), change="remove") <= (pinhole > 0).numpy()).all()


def test_the_cheapest_solid_of_all_scales_is_chosen(
    generator: torch.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    noisy = (TWO_BALLS + 0.03 * torch.randn(P.shape[:3], generator=generator, dtype=torch.float64)).numpy()
    chosen = cost(noisy, find(noisy, (1, 0, 0), smooth=False))
    costs = []
    for scale in (1.0, 2.0):
        monkeypatch.setattr(module, "_SCALES", (scale,))
        costs.append(cost(noisy, find(noisy, (1, 0, 0), smooth=False)))
    assert chosen == min(costs) < 0.5 * max(costs)


def test_solids_that_need_the_other_direction_are_not_found() -> None:
    assert nearest_solid(TWO_BALLS.numpy(), (2, 0, 0), "add") is not None  # nothing to do
    assert nearest_solid(WITH_FLOATER.numpy(), (2, 1, 0), "remove") is None
    assert nearest_solid(ball(P, 0.5).numpy(), (2, 0, 0), "add") is None


@pytest.mark.parametrize("connectivity", [6, 26])
def test_one_connectivity(connectivity: int, generator: torch.Generator) -> None:
    noise = torch.randn(20, 20, 20, generator=generator, dtype=torch.float64).numpy()
    rough = gaussian_filter(noise, 1.0)
    find(rough, (1, 0, 0), smooth=False, connectivity=connectivity)


def test_a_solid_with_the_wanted_topology_is_returned_unchanged() -> None:
    for field in (TORUS, SHELL, TWO_BALLS):
        solid = find(field, tuple(betti_numbers(field).tolist()))
        assert (solid == (field > 0).numpy()).all()


def test_parts_and_cavities_thicker_than_the_body_are_dropped_or_filled() -> None:
    p = grid(28)
    thin = torus(p, 0.6, 0.15)
    dropped = nearest_solid(union(thin, ball(p, 0.25, (0, 0, 0.6))).numpy(), (1, 1, 0), "remove")
    assert np.array_equal(dropped, thin.numpy() > 0)
    slab = block(p, (0.8, 0.8, 0.5))
    hollow = without(slab, ball(p, 0.35)).numpy()
    filled = nearest_solid(hollow, (1, 0, 0), "add")
    assert np.array_equal(filled, slab.numpy() > 0)
    assert nearest_solid(hollow, (1, 0, 0), "remove").sum() < (hollow > 0).sum()


@pytest.mark.parametrize("betti", [(2, 0, 0), (2, 1, 0)])
def test_zeros_are_background(betti: tuple[int, int, int]) -> None:
    p = grid(28)
    two = union(torus(p, 0.28, 0.18, (-0.5, 0, 0)), torus(p, 0.28, 0.18, (0.5, 0, 0)))
    for field in (two.clamp_min(0), (two > 0).double()):
        solid = nearest_solid(field.numpy(), betti, "add")
        assert betti_numbers(solid).tolist() == list(betti)
        assert (solid >= (two.numpy() > 0)).all()


def test_out_of_reach_is_none() -> None:
    assert nearest_solid(ball(P, 0.6).numpy(), (1, 5, 0)) is None
    assert nearest_solid(ball(P, 0.6).numpy(), (2, 0, 0), "add") is None
    assert nearest_solid(np.full((6, 6, 6), -1.0), (1, 1, 0)) is None


@pytest.mark.parametrize(
    ("field", "betti"),
    [
        (union(torus(P, 0.45, 0.2, (-0.2, 0, 0)), ball(P, 0.12, (0.8, 0.7, 0.7))), (1, 0, 0)),  # close, remove
        (union(TORUS, ball(P, 0.13, (0.75, 0.75, 0.75)), ball(P, 0.2, (-0.75, -0.7, 0.7))), (1, 0, 0)),
        (
            without(union(torus(P, 0.5, 0.3), ball(P, 0.1, (0, 0, 0.8))), ball(P, 0.14, (0.5, 0, 0))),
            (1, 1, 0),
        ),
        (union(torus(P, 0.3, 0.12, (-0.48, 0, 0)), torus(P, 0.3, 0.12, (0.48, 0, 0))), (1, 0, 0)),  # join, close both
    ],
)
def test_several_changes_at_once(field: torch.Tensor, betti: tuple[int, int, int]) -> None:
    solid = find(field, betti)
    assert (solid != (field > 0).numpy()).sum() < 0.2 * (field > 0).sum()


def test_changes_that_need_several_level_shifts_are_made_in_stages(
    generator: torch.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Split a noisy dumbbell with a cavity, and drill one half."""
    field = without(
        union(ball(P, 0.38, (-0.5, 0, 0)), DUMBBELL, ball(P, 0.38, (0.5, 0, 0))), ball(P, 0.15, (0.5, 0, 0))
    )
    field = (field + 0.05 * torch.randn(field.shape, generator=generator, dtype=torch.float64)).numpy()
    find(field, (2, 1, 0), smooth=False)
    monkeypatch.setattr(module, "_STAGES", 1)
    assert nearest_solid(field, (2, 1, 0)) is None


@pytest.mark.parametrize("value", [0.0, -1.0, -1e-310, 1e200, -1e200, 5.0])
@pytest.mark.parametrize("shape", [(5, 6, 4), (1, 1, 1), (1, 5, 1)])
def test_constant_fields_become_one_part(value: float, shape: tuple[int, int, int]) -> None:
    solid = find(np.full(shape, value), (1, 0, 0))
    assert solid.sum() == (solid.size if value > 0 else 1)


def test_binary_fields_without_other_levels() -> None:
    for field, betti, _ in CHANGES.values():
        if betti == (1, 0, 0):
            find(np.where(field > 0, 1.0, -1.0), betti)


def test_fields_that_touch_the_border_and_anisotropic_grids() -> None:
    slab = -np.abs(np.arange(17.0) - 8)[None, None, :] + 3.0 + np.zeros((5, 40, 1))
    assert find(slab, (1, 0, 0)).all(axis=(0, 1)).sum() == 5
    holed = slab.copy()
    holed[1:4, 18:22] = -0.5
    assert betti_numbers(holed).tolist() == [1, 1, 0]
    assert (find(holed, (1, 0, 0), change="add") >= (holed > 0)).all()
    find(np.random.default_rng(0).normal(size=(5, 40, 17)), (1, 0, 0), smooth=False)


def test_scale_and_type_do_not_matter() -> None:
    field = without(union(torus(P, 0.5, 0.3), ball(P, 0.1, (0, 0, 0.8))), ball(P, 0.14, (0.5, 0, 0))).numpy()
    solid = find(field, (1, 1, 0))
    for scale in (1e-30, 1e30):
        assert (find(scale * field, (1, 1, 0)) == solid).all()
    assert (find(field.astype(np.float32), (1, 1, 0)) != solid).sum() < 5
    assert (find(field[::-1].copy(), (1, 1, 0)) != solid[::-1]).mean() < 0.01


def test_cost_is_the_sum_of_squares_that_change_sign() -> None:
    field = np.array([[[3.0, -2.0, 0.0, 1.0]]])
    assert cost(field, np.array([[[True, True, False, False]]])) == 5.0
    assert cost(1e300 * field, np.array([[[False] * 4]])) == np.inf
