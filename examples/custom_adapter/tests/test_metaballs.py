"""The adapter passes the conformance tests, and a ring of balls has genus 1."""

from __future__ import annotations

from pathlib import Path

import pytest
from topokit_metaballs import Metaballs

import topokit as tk
from topokit.testing import AdapterConformance

RING = Path(__file__).parents[1] / "ring.metaballs"


class TestMetaballs(AdapterConformance):
    adapter = Metaballs
    euler = 0
    options = {"resolution": 128, "n_samples": 2000}

    def example(self, folder: Path) -> Path:
        return RING


@pytest.mark.parametrize("content", ["metaballs 1\n0 0 0 -1\n", "metaballs 0\n", "metaballs 1\n0 0 nan 1\n"])
def test_balls_without_a_size_are_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.metaballs"
    path.write_text(content)
    with pytest.raises(tk.TopokitError, match="every line must be x y z and a positive radius"):
        tk.load(path)


def test_one_ball_is_a_sphere_of_its_radius(tmp_path: Path) -> None:
    path = tmp_path / "one"
    path.write_text("metaballs 1\n5 0 0 0.5\n")
    shape = tk.load(path, resolution=128)
    assert (shape.samples.points[:, 0] - 5).abs().max() <= 0.5 + 1e-6
    assert shape.report().euler == 2
