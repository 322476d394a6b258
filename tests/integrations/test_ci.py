"""The pre-commit hook by pre-commit itself, and the step of the GitHub Action as the runner runs it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import trimesh

from topokit.testing import icosphere

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
yaml = pytest.importorskip("yaml")
pytestmark = pytest.mark.skipif(
    shutil.which("topokit", path=ENVIRONMENT["PATH"]) is None, reason="the command topokit is not installed"
)


@pytest.fixture
def shapes(tmp_path: Path) -> Path:
    vertices, faces = icosphere(1)
    for name, kept in (("closed.stl", faces), ("open.stl", faces[1:])):
        trimesh.Trimesh(vertices, kept, process=False).export(tmp_path / name)
    return tmp_path


def run(*words: str, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, cwd=cwd, env=ENVIRONMENT | variables, capture_output=True, text=True)


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_the_hook_stops_a_commit_of_an_open_mesh(shapes: Path) -> None:
    """Pre-commit would install topokit with torch for it; the same hook runs with what is installed instead."""
    manifest = ROOT / ".pre-commit-hooks.yaml"
    python = sys.executable
    assert run(python, "-m", "pre_commit", "validate-manifest", str(manifest), cwd=shapes).returncode == 0
    [hook] = yaml.safe_load(manifest.read_text(encoding="utf-8"))
    config = {"repos": [{"repo": "local", "hooks": [hook | {"language": "system"}]}]}
    (shapes / ".pre-commit-config.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    (shapes / "notes.txt").write_text("no shape")
    for words in (["init", "-q"], ["add", "."]):
        assert run("git", *words, cwd=shapes).returncode == 0
    home = {"PRE_COMMIT_HOME": str(shapes / ".cache")}
    found = run(python, "-m", "pre_commit", "run", "--all-files", cwd=shapes, **home)
    assert found.returncode == 1, found.stdout + found.stderr
    assert "open.stl meets open" in found.stdout
    assert "closed.stl meets" not in found.stdout


def step_of_the_action(inputs: dict[str, str]) -> tuple[str, dict[str, str]]:
    """The script of the step with the name report and its variables, with inputs put in as the runner does."""
    action: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
    values = {name: one.get("default", "") for name, one in action["inputs"].items()} | inputs
    [step] = [one for one in action["runs"]["steps"] if one.get("id") == "report"]
    assert step["shell"] == "bash"
    pattern = re.compile(r"\$\{\{ inputs\.([\w-]+) \}\}")
    return step["run"], {name: pattern.sub(lambda found: values[found[1]], text) for name, text in step["env"].items()}


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_the_action_annotates_shapes_and_keeps_a_page(shapes: Path) -> None:
    script, variables = step_of_the_action({"files": "closed.stl\nopen.stl", "options": "--light"})
    summary = {"GITHUB_ACTION_PATH": str(ROOT), "GITHUB_STEP_SUMMARY": str(shapes / "summary.md")}
    ran = run("bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script, cwd=shapes, **variables, **summary)
    assert ran.returncode == 1, ran.stderr
    assert re.findall(r"^::error .*$", ran.stdout, re.MULTILINE) == ["::error file=open.stl,title=topokit::meets open"]
    assert "closed.stl" in (shapes / "summary.md").read_text(encoding="utf-8")
    assert (shapes / "topokit.html").stat().st_size > 1000
