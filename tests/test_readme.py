"""The README's first screen is true: its code runs and prints what its comments say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = Path(__file__).resolve().parents[1] / "README.md"


def test_the_first_example_runs_and_prints_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    code = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    exec(compile(code.group(1), str(README), "exec"), {})
    printed = capsys.readouterr().out
    for line in (
        "mesh: Euler characteristic -4 (certain), genus 3, 1 component, closed",
        "points: Euler characteristic 0 (likely), genus 1, 1 component, closed",
        "\n1\n",
    ):
        assert line in printed
