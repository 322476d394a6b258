"""docs/adapters.md is true: every block of it is written or run in its order, and prints what it says."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from environments import ROOT, Environment

TEXT = (ROOT / "docs" / "adapters.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*) ?(\S*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def run(command: str, environment: Environment, folder: Path) -> str:
    """One line of a shell block: a command of pip, pytest or topokit, and nothing else."""
    match shlex.split(command):
        case ["pip", "install", package]:
            environment.install(folder / package)
            return ""
        case ["pip", "uninstall", "--yes", name]:
            environment.uninstall(name)
            return ""
        case ["pytest", tests]:
            found = environment.pytest(folder / tests)
        case ["topokit", *arguments]:
            found = environment.topokit(*arguments, cwd=folder)
        case _:
            pytest.fail(f"docs/adapters.md asks for {command!r}, which this test does not know how to run")
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


@pytest.mark.long
def test_every_block_does_what_it_says(tmp_path: Path) -> None:
    environment = Environment.make(tmp_path / "environment")
    folder = tmp_path / "work"
    printed = ""
    for language, path, content in BLOCKS:
        if path:
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(content, encoding="utf-8")
        elif language == "python":
            found = environment.python("-c", content, cwd=folder)
            assert found.returncode == 0, found.stderr
            printed = found.stdout
        elif language == "sh":
            printed = "".join(run(line, environment, folder) for line in content.splitlines())
        else:
            assert language == "text"
            missing = [line for line in content.splitlines() if line not in printed.splitlines()]
            assert missing == [], f"printed was:\n{printed}"
    assert "rings" not in environment.topokit("adapters").stdout


def test_no_block_is_overlooked() -> None:
    assert TEXT.count("```") == 2 * len(BLOCKS)
    assert {language for language, _, _ in BLOCKS} == {"python", "sh", "text", "toml"}
    assert any("AdapterConformance" in content for _, path, content in BLOCKS if path.endswith(".py"))
