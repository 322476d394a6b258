"""Certificates of functions and networks, in reports and on the command line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app

Function = Callable[[Tensor], Tensor]


def torus(x: Tensor) -> Tensor:
    return (x[:, :2].norm(dim=1) - 0.6) ** 2 + x[:, 2] ** 2 - 0.04


def touching(x: Tensor) -> Tensor:
    """Two balls that touch."""
    shift = x.new_tensor((0.3, 0, 0))
    return torch.minimum((x - shift).norm(dim=1), (x + shift).norm(dim=1)) - 0.3


def test_a_proven_level_set_is_certain() -> None:
    shape = tk.from_sdf(torus, bounds=(-1, 1), resolution=128)
    report = shape.report(certify=True)
    assert (report.verdict, report.euler, report.genus, report.components) == ("certain", 0, 1, 1)
    assert (report.confidence, report.closed, report.boundary_loops, report.resolution) == (1.0, True, 0, None)
    assert report.solid_betti == (1, 1, 0)
    assert report.reasons[0].startswith("Proven")
    assert shape.report(certify=False).verdict == "likely", "without a proof"
    found = shape.certify()
    assert (found.verdict, found.euler, found.genus, found.places) == ("certain", 0, 1, ())
    assert found.surface is not None
    near = torus(torch.from_numpy(found.surface.vertices))
    assert float(near.abs().max()) < 0.05


def test_reports_become_certain_where_a_proof_costs_no_more_than_the_grids() -> None:
    shape = tk.from_sdf(torus, bounds=(-1, 1), resolution=128)
    by_grids, both = shape.report(certify=False), shape.report()
    assert (by_grids.verdict, both.verdict) == ("likely", "certain")
    assert (both.euler, both.genus, both.solid_betti) == (by_grids.euler, by_grids.genus, by_grids.solid_betti)
    assert both.reasons[1:] == by_grids.reasons
    assert [one.integer for one in both.evidence] == [0, 0]
    assert both.per_component is by_grids.per_component, "grids measure better than the triangles of a proof"
    assert (both.resolution, both.confidence) == (None, 1.0)
    again = tk.from_sdf(torus, bounds=(-1, 1), resolution=128).report()
    assert (again.reasons, again.evidence) == (both.reasons, both.evidence), "no seconds in it"


def with_spike(f: Function) -> Function:
    """A function with a part of 0.001 that no grid of 128 cells sees, not even by its slope."""

    def spiked(x: Tensor) -> Tensor:
        return f(x) - torch.relu(1 - 1000 * (x - x.new_tensor((0.5, 0.5, 0.511))).abs().sum(1))

    return spiked


def test_a_part_that_grids_miss_is_counted_by_bounds() -> None:
    shape = tk.from_sdf(with_spike(lambda x: x.norm(dim=1) - 0.6), bounds=(-1, 1), resolution=128)
    by_grids, both = shape.report(certify=False), shape.report()
    assert (by_grids.verdict, by_grids.euler) == ("likely", 2)
    assert (both.verdict, both.euler, both.components) == ("certain", 4, 2)
    assert [one.integer for one in both.evidence] == [4, 2]
    assert "see another surface, of χ 2" in both.reasons[1]


def test_what_bounds_contradict_is_not_likely_even_if_nothing_is_proven() -> None:
    """As many cells as the grids pay for do not prove this torus, but they find the spike."""
    shape = tk.from_sdf(with_spike(torus), bounds=(-1, 1), resolution=128)
    by_grids, both = shape.report(certify=False), shape.report()
    assert (by_grids.verdict, by_grids.euler) == ("likely", 0)
    assert (both.verdict, both.euler, both.n_deciding) == ("unsure", 0, 2)
    assert "places that bounds leave" in both.reasons[0]
    assert "Bounds prove nothing" in both.reasons[-1]
    assert shape.certify().euler == 2


def test_functions_without_bounds_are_reported_as_ever() -> None:
    def rounded(x: Tensor) -> Tensor:
        return torus(x) + 0 * torch.floor(x).sum(1)

    def branching(x: Tensor) -> Tensor:
        return torus(x) if len(x) != 1 else torus(x) + float(x[0, 0].item() > 2)

    def asserting(x: Tensor) -> Tensor:
        assert len(x) > 1, "no single points"
        return torus(x)

    for f in (rounded, branching, asserting):
        shape = tk.from_sdf(f, bounds=(-1, 1), resolution=128)
        assert shape.report() == shape.report(certify=False)
        assert shape.report().verdict == "likely"


def test_what_stays_open_is_said_with_its_place() -> None:
    shape = tk.from_sdf(touching, bounds=(-1, 1), resolution=128)
    found = shape.certify(time_limit=30)
    assert (found.verdict, found.components, found.euler, found.answer) == ("unsure", None, None, None)
    [(low, high)] = found.places
    assert all(a <= 0 <= b for a, b in zip(low, high, strict=True))
    report = shape.report(certify=True)
    assert report.verdict != "certain"
    assert any("Not proven: 8 cells" in reason and "1 place" in reason for reason in report.reasons)


def test_a_level_set_that_leaves_the_box_is_not_certain() -> None:
    found = tk.from_sdf(lambda x: x[:, 2] - 0.1, bounds=(-1, 1)).certify()
    assert found.verdict == "unsure"
    assert found.reached == ("x = -1", "x = 1", "y = -1", "y = 1")
    assert found.components is not None
    assert "1 loop" in found.statement


@pytest.mark.parametrize("level", [0.5, 0.9])
def test_occupancies_and_logits_have_the_same_proof(level: float) -> None:
    def logits(x: Tensor) -> Tensor:
        return -8 * torus(x)

    shapes = (
        tk.from_occupancy(lambda x: logits(x).sigmoid(), bounds=(-1, 1), level=level),
        tk.from_occupancy(logits, bounds=(-1, 1), level=level, logits=True),
    )
    eulers = [shape.certify().euler for shape in shapes]
    assert eulers[0] == eulers[1] is not None


def test_a_network_in_single_precision() -> None:
    torch.manual_seed(0)
    net = nn.Sequential(nn.Linear(3, 16), nn.ReLU(), nn.Linear(16, 16), nn.ReLU(), nn.Linear(16, 1))

    def function(x: Tensor) -> Tensor:
        return x.norm(dim=1) - 0.6 + 0.1 * net(x)[:, 0]

    report = tk.from_sdf(function, bounds=(-1, 1)).report(certify=True)
    assert (report.verdict, report.euler) == ("certain", 2)


def test_functions_that_cannot_be_proven_are_refused() -> None:
    with pytest.raises(tk.InputError, match="uses floor"):
        tk.from_sdf(lambda x: x.norm(dim=1) - 0.5 + 0 * torch.floor(x).sum(1), bounds=(-1, 1)).certify()
    with pytest.raises(tk.InputError, match="other values"):
        tk.from_sdf(lambda x: x.norm(dim=1) - 0.5 + 0.1 * (len(x) > 1), bounds=(-1, 1)).certify()
    with pytest.raises(tk.InputError, match="other values"):
        tk.from_sdf(lambda x: x.norm(dim=1) - 0.5 + 0.01 * x.sum(), bounds=(-1, 1)).certify()
    with pytest.raises(tk.InputError, match="time_limit"):
        tk.from_sdf(torus, bounds=(-1, 1)).certify(time_limit=0)
    with pytest.raises(tk.InputError, match="not made from a function"):
        tk.from_mesh(tk.testing.genus_mesh(1)).certify()
    assert tk.from_mesh(tk.testing.genus_mesh(1)).report(certify=True).verdict == "certain"


@pytest.mark.filterwarnings("ignore:.*torch.jit.trace:DeprecationWarning")
def test_the_command_line_certifies(tmp_path: Path) -> None:
    class Torus(nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            return torus(x)

    path = tmp_path / "torus.pt"
    torch.jit.save(torch.jit.trace(Torus(), torch.zeros(5, 3)), path)
    options = ["report", str(path), "--adapter", "sdf", "--bounds", "-1,1", "--certify", "--json"]
    result = CliRunner().invoke(app, options)
    assert result.exit_code == 0, result.output
    [record] = json.loads(result.stdout)
    assert (record["verdict"], record["euler"]) == ("certain", 0)
