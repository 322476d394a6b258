"""The nearest solid of a wanted topology: six kinds of change, noise, ties, and what is out of reach."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from analytic_fields import ball, block, grid, meshed_topology, rod, torus, union, without
from scipy.ndimage import gaussian_filter

from topokit.core.grid.components import betti_numbers
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


def found(
    field: torch.Tensor | np.ndarray, betti: tuple[int, int, int], smooth: bool = True, **options: object
) -> np.ndarray:
    """The nearest solid, its numbers checked in both connectivities and, if its surface is smooth, by marching cubes.

    Where voxels meet through an edge alone marching cubes decides face by face, and agrees with neither connectivity.
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
def test_each_kind_of_change_is_found_and_is_small(name):
    field, betti, change = CHANGES[name]
    present = (field > 0).numpy()
    solid = found(field, betti, change=change)
    assert (solid > present).any() if change == "add" else (solid < present).any()
    assert (solid >= present).all() if change == "add" else (solid <= present).all()
    assert (solid != present).sum() <= 0.12 * present.sum()
    assert cost(field.numpy(), found(field, betti)) <= cost(field.numpy(), solid)


@pytest.mark.parametrize("name", CHANGES)
def test_each_kind_of_change_under_noise(name, generator):
    field, betti, _ = CHANGES[name]
    noise = torch.randn(field.shape, generator=generator, dtype=torch.float64)
    noisy = field + 0.03 * noise
    assert betti_numbers(noisy).tolist() != betti_numbers(field).tolist()
    solid = found(noisy, betti, smooth=False)
    assert (solid != (noisy > 0).numpy()).sum() < 0.25 * (field > 0).sum()


def test_what_is_symmetric_is_not_all_or_nothing():
    """A ring has no weakest place, and of equal parts none comes first."""
    present = (TORUS > 0).numpy()
    cut = found(TORUS, (1, 0, 0), change="remove")
    assert (cut <= present).all()
    assert 0 < (cut < present).sum() < 0.1 * present.sum()
    four = union(*(ball(P, 0.3, (x, y, 0)) for x, y in ((0.5, 0.1), (-0.5, -0.1), (0.1, -0.5), (-0.1, 0.5))))
    found(four, (3, 0, 0))


def test_of_raising_and_lowering_the_level_the_cheaper_is_taken():
    """Two links become a ball by filling gap and holes; or by breaking both and drawing the crumbs out again."""
    links = union(torus(P, 0.3, 0.12, (-0.48, 0, 0)), torus(P, 0.3, 0.12, (0.48, 0, 0))).numpy()
    solid = found(links, (1, 0, 0))
    assert (solid >= (links > 0)).all()
    assert cost(links, solid) < 0.5 * cost(links, found(links, (1, 0, 0), change="remove"))


def test_only_what_was_allowed_is_done():
    """A torus becomes a ball by a membrane in its hole, or by a cut through its tube."""
    present = (TORUS > 0).numpy()
    added, removed = found(TORUS, (1, 0, 0), change="add"), found(TORUS, (1, 0, 0), change="remove")
    assert (added > present).any()
    assert (added >= present).all()
    assert (removed < present).any()
    assert (removed <= present).all()


@pytest.mark.parametrize("change", ["add", "remove"])
def test_noise_may_be_mended_one_way_only(change, generator):
    noisy = (ball(P, 0.6) + 0.1 * torch.randn(P.shape[:3], generator=generator, dtype=torch.float64)).numpy()
    solid = found(noisy, (1, 0, 0), smooth=False, change=change)
    assert (solid >= (noisy > 0)).all() if change == "add" else (solid <= (noisy > 0)).all()


def test_what_smoothing_wipes_out_is_kept_where_nothing_may_go():
    speck, pinhole = TORUS.clone(), ball(P, 0.5).clone()
    speck[3, 3, 3], pinhole[14, 14, 14] = 0.02, -0.02
    assert (found(speck, (1, 0, 0), change="add") >= (speck > 0).numpy()).all()
    assert (found(pinhole, (1, 0, 0), change="remove") <= (pinhole > 0).numpy()).all()


def test_of_all_scales_the_cheapest_solid_is_taken(generator, monkeypatch):
    noisy = (TWO_BALLS + 0.03 * torch.randn(P.shape[:3], generator=generator, dtype=torch.float64)).numpy()
    chosen = cost(noisy, found(noisy, (1, 0, 0), smooth=False))
    costs = []
    for scale in (1.0, 2.0):
        monkeypatch.setattr(module, "_SCALES", (scale,))
        costs.append(cost(noisy, found(noisy, (1, 0, 0), smooth=False)))
    assert chosen == min(costs) < 0.5 * max(costs)


def test_a_change_of_the_wrong_direction_alone_is_not_found():
    assert nearest_solid(TWO_BALLS.numpy(), (2, 0, 0), "add") is not None  # nothing to do
    assert nearest_solid(WITH_FLOATER.numpy(), (2, 1, 0), "remove") is None
    assert nearest_solid(ball(P, 0.5).numpy(), (2, 0, 0), "add") is None


@pytest.mark.parametrize("connectivity", [6, 26])
def test_one_connectivity_alone(connectivity, generator):
    noise = torch.randn(20, 20, 20, generator=generator, dtype=torch.float64).numpy()
    rough = gaussian_filter(noise, 1.0)
    found(rough, (1, 0, 0), smooth=False, connectivity=connectivity)


def test_what_is_right_stays_as_it_is(generator):
    for field in (TORUS, SHELL, TWO_BALLS):
        solid = found(field, tuple(betti_numbers(field).tolist()))
        assert (solid == (field > 0).numpy()).all()


def test_what_is_thicker_than_the_body_is_dropped_or_filled():
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
def test_a_background_that_lies_on_the_level_is_background(betti):
    p = grid(28)
    two = union(torus(p, 0.28, 0.18, (-0.5, 0, 0)), torus(p, 0.28, 0.18, (0.5, 0, 0)))
    for field in (two.clamp_min(0), (two > 0).double()):
        found = nearest_solid(field.numpy(), betti, "add")
        assert betti_numbers(found).tolist() == list(betti)
        assert (found | (two.numpy() > 0) == found).all()


def test_out_of_reach_is_none():
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
def test_several_changes_at_once(field, betti):
    solid = found(field, betti)
    assert (solid != (field > 0).numpy()).sum() < 0.2 * (field > 0).sum()


def test_what_one_movement_of_the_level_cannot_do_is_done_in_stages(generator, monkeypatch):
    """A noisy dumbbell with a cavity is to be split, and one half drilled."""
    field = without(
        union(ball(P, 0.38, (-0.5, 0, 0)), DUMBBELL, ball(P, 0.38, (0.5, 0, 0))), ball(P, 0.15, (0.5, 0, 0))
    )
    field = (field + 0.05 * torch.randn(field.shape, generator=generator, dtype=torch.float64)).numpy()
    found(field, (2, 1, 0), smooth=False)
    monkeypatch.setattr(module, "_STAGES", 1)
    assert nearest_solid(field, (2, 1, 0)) is None


@pytest.mark.parametrize("value", [0.0, -1.0, -1e-310, 1e200, -1e200, 5.0])
@pytest.mark.parametrize("shape", [(5, 6, 4), (1, 1, 1), (1, 5, 1)])
def test_constant_fields_become_one_part(value, shape):
    solid = found(np.full(shape, value), (1, 0, 0))
    assert solid.sum() == (solid.size if value > 0 else 1)


def test_binary_fields_have_no_levels_but_are_mended():
    for field, betti, _ in CHANGES.values():
        if betti == (1, 0, 0):
            found(np.where(field > 0, 1.0, -1.0), betti)


def test_fields_that_touch_the_border_and_anisotropic_grids():
    slab = -np.abs(np.arange(17.0) - 8)[None, None, :] + 3.0 + np.zeros((5, 40, 1))
    assert found(slab, (1, 0, 0)).all(axis=(0, 1)).sum() == 5
    holed = slab.copy()
    holed[1:4, 18:22] = -0.5
    assert betti_numbers(holed).tolist() == [1, 1, 0]
    assert (found(holed, (1, 0, 0), change="add") >= (holed > 0)).all()
    found(np.random.default_rng(0).normal(size=(5, 40, 17)), (1, 0, 0), smooth=False)


def test_scale_and_type_do_not_matter():
    field = without(union(torus(P, 0.5, 0.3), ball(P, 0.1, (0, 0, 0.8))), ball(P, 0.14, (0.5, 0, 0))).numpy()
    solid = found(field, (1, 1, 0))
    for scale in (1e-30, 1e30):
        assert (found(scale * field, (1, 1, 0)) == solid).all()
    assert (found(field.astype(np.float32), (1, 1, 0)) != solid).sum() < 5
    assert (found(field[::-1].copy(), (1, 1, 0)) != solid[::-1]).mean() < 0.01


def test_cost_is_the_sum_of_squares_that_change_sign():
    field = np.array([[[3.0, -2.0, 0.0, 1.0]]])
    assert cost(field, np.array([[[True, True, False, False]]])) == 5.0
    assert cost(1e300 * field, np.array([[[False] * 4]])) == np.inf
