"""Grids that are evaluated box by box: every number equals that of the grid as a whole, however it is cut."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from topokit.core.blocks.division import Division
from topokit.core.blocks.whole import count_solid
from topokit.core.grid.grid import Grid
from topokit.core.implicit import blockwise
from topokit.core.implicit.adaptive_grid import AdaptiveField, dense_field, refine_grid, refine_in_box
from topokit.core.implicit.blockwise import Blocks, Refinements, next_grid
from topokit.core.implicit.convergence import ConvergenceStudy, convergence_study

Function = Callable[[Tensor], Tensor]

BOX = (-1.0, -0.8, -1.0), (1.0, 1.0, 0.5)
FINEST = 32
COMPARED = ("counts", "euler", "has_converged", "shifted_eulers", "n_unseen", "reached_faces", "finest")


def waves(seed: int) -> Function:
    """A random field of eight waves, with features from larger than the box to smaller than a cell."""
    generator = torch.Generator().manual_seed(seed)
    frequencies = torch.randn(8, 3, generator=generator, dtype=torch.float64) * (2.0 + seed % 17)
    amplitudes, phases = torch.randn(2, 8, generator=generator, dtype=torch.float64)
    return lambda x: (torch.sin(x @ frequencies.T + 9 * phases) * amplitudes).sum(1) - seed % 3 + 1.0


def step_rods(seed: int) -> Function:
    """Rods through a ball as a step function: only the changing sign says where they are, so they must be followed."""
    generator = torch.Generator().manual_seed(seed)
    ends = 1.8 * torch.rand(5, 2, 3, generator=generator, dtype=torch.float64) - 0.9
    radii = 0.02 + 0.04 * torch.rand(5, generator=generator, dtype=torch.float64)

    def inside(x: Tensor) -> Tensor:
        best = 0.35 - x.norm(dim=1)
        for (a, b), radius in zip(ends, radii, strict=True):
            along = ((x - a) @ (b - a) / (b - a).square().sum()).clamp(0, 1)
            best = torch.maximum(best, radius - (x - a - along[:, None] * (b - a)).norm(dim=1))
        return torch.where(best > 0, 1.0, -1.0) + 0.1 * torch.sin(x[:, 0])

    return inside


def network(seed: int) -> Function:
    """An untrained network; in double precision, as the last bit of a value may depend on the rest of its batch."""
    generator = torch.Generator().manual_seed(seed)
    first = torch.randn(3, 16, generator=generator, dtype=torch.float64)
    second, shift = torch.randn(2, 16, generator=generator, dtype=torch.float64)
    return lambda x: (3 * x @ first + shift).tanh() @ second


functions = st.one_of(*(st.builds(kind, st.integers(0, 10_000)) for kind in (waves, step_rods, network)))


def coarsest(f: Function) -> AdaptiveField | None:
    """The field on the coarsest grid; None if there is nothing to count on it."""
    field = dense_field(f, Grid.covering(*BOX, 8))
    inside = field.values > 0
    return field if inside.any() and not inside.all() else None


def assert_equal_surfaces(f: Function, study: ConvergenceStudy, blocks: Blocks) -> None:
    """The surfaces of the grid that is shown, counted in boxes and as a whole."""
    from topokit.core.implicit.block_components import components_in_blocks

    whole = study.known.base
    for _ in study.known.followed:
        whole = refine_grid(whole, f).field
    for connectivity in (6, 26):
        found = components_in_blocks(study.known, connectivity, blocks)
        expected = count_solid(whole.values, lambda values: values > 0, connectivity, whole.grid).surfaces
        for one in fields(expected):
            assert np.array_equal(getattr(found, one.name), getattr(expected, one.name)), one.name


@settings(max_examples=5, deadline=None)
@given(functions, st.integers(700, 20_000), st.sampled_from((8, 16)))
def test_every_number_is_that_of_the_whole_grid(f: Function, most_vertices: int, kept_cells: int) -> None:
    field = coarsest(f)
    if field is None:
        return
    whole = convergence_study(field, f, FINEST, kept_cells=FINEST)
    cut = convergence_study(field, f, FINEST, blocks=Blocks(most_vertices), kept_cells=kept_cells)
    for name in COMPARED:
        assert getattr(cut, name) == getattr(whole, name), name
    assert_equal_surfaces(f, cut, Blocks(most_vertices))


@settings(max_examples=15, deadline=None)
@given(functions, st.data())
def test_a_box_holds_what_the_whole_grid_holds_there(f: Function, data: st.DataObject) -> None:
    field = coarsest(f)
    if field is None:
        return
    first = refine_grid(field, f)
    second = refine_grid(first.field, f)
    ends = [sorted(data.draw(st.sets(st.integers(0, n), min_size=2, max_size=2))) for n in second.field.grid.shape]
    x, y, z = ((start, stop) for start, stop in ends)
    found, expected = (
        refine_in_box(field, (x, y, z), f, (first.followed, second.followed)),
        second.field.part((x, y, z)),
    )
    if isinstance(found, bool):
        assert bool(((expected.values > 0) == found).all())
    else:
        assert torch.equal(found.field.values, expected.values)
        assert torch.equal(found.field.known, expected.known)


def test_boxes_are_done_again_when_the_zero_set_leads_into_them(monkeypatch: pytest.MonkeyPatch) -> None:
    rounds = []
    usual = blockwise.mapped
    monkeypatch.setattr(
        blockwise, "mapped", lambda work, tasks, client: rounds.append(len(tasks)) or usual(work, tasks, client)
    )
    f = step_rods(0)
    field = coarsest(f)
    assert field is not None
    found = next_grid(Refinements(field, f), Blocks(700), 1.0, 0.1)
    expected = refine_grid(field, f)
    assert len(rounds) > 1
    assert rounds[0] == len(Division.even(expected.field.grid.shape, 700).boxes)
    assert len(expected.followed) > 0
    assert torch.equal(found.known.followed[-1], expected.followed)


def test_a_change_that_grows_is_looked_at_again() -> None:
    f = waves(3)
    field = coarsest(f)
    assert field is not None
    known = Refinements(field, f)
    right = next_grid(known, Blocks(3000), 1e3, 0.1)
    again = next_grid(known, Blocks(3000), 1e-6, 0.1)
    assert again.change == right.change
    assert again.eulers_at_shifts((-0.1, 0.1)) == right.eulers_at_shifts((-0.1, 0.1))
    assert again.n_evaluations > right.n_evaluations


def test_the_field_of_a_step_function_is_followed_in_any_order() -> None:
    f = step_rods(1)
    field = coarsest(f)
    assert field is not None
    whole = refine_grid(field, f)
    n_x, n_y, n_z = whole.field.grid.shape
    some = whole.followed[::3]
    told = refine_in_box(field, ((0, n_x), (0, n_y), (0, n_z)), f, (some,))
    assert not isinstance(told, bool)
    assert torch.equal(told.field.known, whole.field.known)
    assert torch.equal(told.followed, whole.followed)


@pytest.mark.parametrize(
    ("shape", "most"), [((9, 9, 9), 1), ((65, 9, 33), 100), ((65, 9, 33), 1 << 21), ((2049, 2049, 2049), 1 << 21)]
)
def test_even_blocks_cover_the_volume_once(shape: tuple[int, int, int], most: int) -> None:
    division = Division.even(shape, most)
    assert division.shape == shape
    for cuts in division.cuts:
        lengths = np.diff(cuts)
        assert lengths.min() >= 1
        assert lengths.max() - lengths.min() <= 1
    assert max(np.prod([b - a for a, b in box]) for box in division.boxes) <= most
