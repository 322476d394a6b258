"""Parts of a level set that no grid point shows: an answer without them is never likely."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

import topokit as tk
from topokit.core.grid.grid import Grid
from topokit.core.implicit.adaptive_grid import dense_field
from topokit.core.implicit.blockwise import Blocks
from topokit.core.implicit.convergence import ConvergenceStudy, convergence_study
from topokit.core.implicit.unseen_parts import carries_distance

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
ROUGH: dict[str, Any] = {"bounds": BOX, "resolution": 128}

Function = Callable[[Tensor], Tensor]


def pierced_ball(radius: float) -> Function:
    """The distance of a ball with a straight tunnel that misses the vertices of grids."""

    def distance(x: Tensor) -> Tensor:
        from_axis = torch.hypot(x[:, 0] - 0.0113, x[:, 1] - 0.0071)
        return torch.maximum(x.norm(dim=1) - 0.7, radius - from_axis)

    return distance


def with_floater(radius: float, seed: int) -> Function:
    """The distance of a ball and of a small one at a random place beside it."""
    direction, away = torch.randn(3, generator=torch.Generator().manual_seed(seed)), 0.45 + 0.04 * (seed % 10)
    place = away * torch.nn.functional.normalize(direction, dim=0)
    return lambda x: torch.minimum(x.norm(dim=1) - 0.3, (x - place).norm(dim=1) - radius)


def steep(distance: Function, slope: float) -> Function:
    return lambda x: torch.sigmoid(-slope * distance(x))


@pytest.mark.parametrize("radius", [0.003, 0.005])
def test_thin_tunnel_is_not_likely_filled(radius: float) -> None:
    report = tk.from_sdf(pierced_ball(radius), **ROUGH).report()
    assert (report.euler, report.verdict) == (2, "unsure")  # no grid of these sees it: χ is 0
    assert "between grid points that are all on one side" in report.reasons[0]
    assert report.n_deciding == 1
    assert tk.from_sdf(pierced_ball(0.1), **ROUGH).report(certify=False).verdict == "likely"


def test_at_least_three_grids_are_counted() -> None:
    def study(cells: int, finest: int) -> ConvergenceStudy:
        field = dense_field(lambda x: 0.7 - x.norm(dim=1), Grid.covering(*BOX, cells))
        return convergence_study(field, lambda x: 0.7 - x.norm(dim=1), finest)

    for cells, finest in ((32, 64), (32, 32), (32, 63)):
        found = study(cells, finest)
        n_last = cells * (finest // cells)
        assert [count.n_cells for count in found.counts] == [n_last // 4, n_last // 2, n_last]
        assert (found.has_converged, found.first_step, found.shown.n_cells) == (True, 2 / cells, cells)
    assert study(32, 32).n_evaluations == 33**3


@pytest.mark.parametrize(("radius", "seed", "slope"), [(0.006, 1, 200), (0.01, 2, 1000)])
def test_a_floater_that_a_steep_occupancy_hides_is_not_likely_missing(radius: float, seed: int, slope: float) -> None:
    shape = tk.from_occupancy(steep(with_floater(radius, seed), slope), **ROUGH)
    assert (shape.report().verdict, shape.report().euler) == ("certain", 4), "bounds see it"
    report = shape.report(certify=False)
    assert report.verdict == "unsure"
    assert "jumps to a constant within 0.0156" in report.reasons[report.n_deciding - 1]
    assert "logits=True" in str(report.advice)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_every_vertex_is_evaluated_where_an_occupancy_is_steep(seed: int) -> None:
    report = tk.from_occupancy(steep(with_floater(0.016, seed), 1000), **ROUGH).report()
    assert (report.euler, report.components) == (4, 2)  # wider than a cell's diagonal on 128 cells, not on 64


@pytest.mark.parametrize("kind", ["distance", "log-odds", "gentle"])
@pytest.mark.parametrize("radius", [0.006, 0.014])
def test_a_floater_in_a_field_that_carries_distance_is_noticed(kind: str, radius: float) -> None:
    distance = with_floater(radius, 0)
    if kind == "distance":
        shape = tk.from_sdf(distance, **ROUGH)
    elif kind == "log-odds":
        shape = tk.from_occupancy(lambda x: -200 * distance(x), logits=True, **ROUGH)
    else:
        shape = tk.from_occupancy(steep(distance, 50), **ROUGH)
    report = shape.report()
    assert report.euler == 4 or report.verdict == "unsure"
    assert not any("jumps" in reason for reason in report.reasons)


@pytest.mark.parametrize("cells", [32, 64])
def test_what_carries_distance(cells: int) -> None:
    """Whatever the scale and the slope; an occupancy as long as its flank is wider than about two cells."""
    grid = Grid.covering(*BOX, cells)

    def answer(f: Function) -> bool:
        return carries_distance(dense_field(lambda x: -f(x), grid).values)

    ball = with_floater(0.1, 0)
    width = 2 / cells
    assert all(answer(f) for f in (ball, lambda x: 1e6 * ball(x), lambda x: ball(x) ** 3, lambda x: ball(x) * 1e-6))
    assert answer(lambda x: torch.tanh(ball(x) / (2 * width)))
    assert answer(lambda x: ball(x).clamp(-2.5 * width, 2.5 * width))
    assert not answer(lambda x: ball(x).clamp(-width, width))
    assert not answer(lambda x: torch.tanh(ball(x) * 2 / width))
    assert not answer(lambda x: torch.where(ball(x) > 0, 1.0, -1.0))
    assert not answer(lambda x: torch.where(ball(x) > 0, torch.inf, -torch.inf))
    assert not answer(lambda x: torch.where(ball(x) > 0, 0.1, ball(x)))  # constant on one side only


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_a_floater_that_three_grids_see_is_likely(seed: int) -> None:
    for shape in (
        tk.from_sdf(with_floater(0.03, seed), bounds=BOX, resolution=256),
        tk.from_occupancy(steep(with_floater(0.03, seed), 50), bounds=BOX, resolution=512),
    ):
        assert [shape.report(certify=choice).euler for choice in (False, None)] == [4, 4]
        assert [shape.report(certify=choice).verdict for choice in (False, None)] == ["likely", "certain"]


def test_places_are_the_same_on_a_grid_in_boxes() -> None:
    def inside(x: Tensor) -> Tensor:
        return -pierced_ball(0.004)(x)

    coarsest = dense_field(inside, Grid.covering((-1.0, -0.8, -1.0), (1.0, 1.0, 0.5), 16))
    whole = convergence_study(coarsest, inside, 64)
    assert whole.n_unseen > 50
    assert whole.has_converged
    for most_vertices, kept_cells in ((8_000, 16), (30_000, 32)):
        cut = convergence_study(coarsest, inside, 64, blocks=Blocks(most_vertices), kept_cells=kept_cells)
        assert (cut.n_unseen, cut.counts, cut.euler) == (whole.n_unseen, whole.counts, whole.euler)
