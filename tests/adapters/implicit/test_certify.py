"""Certificates of functions and networks, in reports and on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app


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
    assert shape.report().verdict == "likely", "without a proof"
    found = shape.certify()
    assert (found.verdict, found.euler, found.genus, found.places) == ("certain", 0, 1, ())
    assert found.surface is not None
    near = torus(torch.from_numpy(found.surface.vertices))
    assert float(near.abs().max()) < 0.05


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
