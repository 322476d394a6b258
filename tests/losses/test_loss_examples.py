"""The examples of the topology loss reach the topology they name, by a count that tells tori from balls."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SURFACES = re.compile(r"(\d+) surfaces?: \d+ − \d+ \+ \d+ = (-?\d+), genus (\d+)")
COST = re.compile(r"([+-]\d+\.\d)%")


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("close_a_hole", (1, 0, 1), (1, 2, 0)),
        ("drill_a_hole", (1, 2, 0), (1, 0, 1)),
        ("join_parts", (2, 2, 0), (1, 2, 0)),
        ("points_close_gap", (1, 2, 0), (1, 0, 1)),
        ("remove_floaters", (11, 0, 1), (1, 0, 1)),
    ],
)
def test_an_example_reaches_its_topology(
    name: str, before: tuple[int, int, int], after: tuple[int, int, int], tmp_path: Path
) -> None:
    """Surfaces, then χ and genus of the largest; the data term rises by a tenth at most, where it can be compared."""
    run = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", str(EXAMPLES / f"{name}.py")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    found = [tuple(map(int, match)) for match in SURFACES.findall(run.stdout)]
    assert len(found) == 2, run.stdout
    if name == "remove_floaters":  # their number depends on rounding
        assert found[0][0] > 3
        assert found[0][1:] == before[1:]
    else:
        assert found[0] == before
    assert found[1] == after
    costs = COST.findall(run.stdout)
    assert len(costs) == (name != "points_close_gap")
    assert all(float(cost) <= 10 for cost in costs)
    picture = np.asarray(Image.open(tmp_path / f"{name}.png"))
    assert picture.shape == (400, 800, 3)
    assert not np.array_equal(picture[:, :400], picture[:, 400:])


def test_the_count_tells_a_torus_from_a_ball(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    from _judge import describe_surfaces

    axis = torch.linspace(-1, 1, 32)
    x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
    radius = torch.hypot(torch.hypot(x, y), z)
    torus = 0.2 - torch.hypot(torch.hypot(x, y) - 0.6, z)
    assert describe_surfaces(torus).endswith(" = 0, genus 1")
    assert describe_surfaces(torch.maximum(torus, 0.2 - radius)).startswith("2 surfaces: ")
    assert (
        describe_surfaces(0.1 - (radius - 0.6).abs()).count(" = 2, genus 0") == 2
    )  # a hollow ball, outside and inside
    assert describe_surfaces(torch.ones(3, 3, 3)).endswith(" = 2, genus 0")
    assert describe_surfaces(-torch.ones(3, 3, 3)) == "0 surfaces"
