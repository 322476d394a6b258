"""The first code of the README and of the page on the topology loss runs and prints what it says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def run_first_code(page: Path) -> None:
    code = re.search(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    exec(compile(code.group(1), str(page), "exec"), {})


def test_the_first_example_runs_and_prints_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    run_first_code(ROOT / "README.md")
    printed = capsys.readouterr().out
    for line in (
        "mesh: Euler characteristic -4 (certain), genus 3, 1 component, closed",
        "points: Euler characteristic 0 (likely), genus 1, 1 component, closed",
        "\n1\n",
    ):
        assert line in printed


def test_the_first_example_of_the_topology_loss_closes_its_hole(capsys: pytest.CaptureFixture[str]) -> None:
    run_first_code(ROOT / "docs" / "topology-loss.md")
    assert "euler=2, components=1, tunnels=0, cavities=0" in capsys.readouterr().out
