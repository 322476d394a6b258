"""The wheel holds what runs from it, and no message sends the user to a page that it does not hold."""

from __future__ import annotations

import ast
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import topokit

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(topokit.__file__).parent


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    target = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(target)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    (wheel,) = target.iterdir()
    return set(zipfile.ZipFile(wheel).namelist())


def test_the_wheel_holds_every_file_of_the_package(held: set[str]) -> None:
    files = {path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert {str(path.relative_to(ROOT)) for path in files} == {name for name in held if name.startswith("topokit/")}
    assert {"topokit/py.typed", "topokit/__init__.pyi", "topokit/pages/static/viewer.min.js"} <= held


def texts(tree: ast.AST) -> list[str]:
    """String constants of a module, without its docstrings."""
    described = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = {
        id(node.body[0].value) for node in ast.walk(tree) if isinstance(node, described) and ast.get_docstring(node)
    }
    constants = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in docstrings)
    return [node.value for node in constants if isinstance(node.value, str)]


def test_no_message_names_a_page_that_is_not_installed() -> None:
    for path in PACKAGE.rglob("*.py"):
        if path.name != "verdict.py":  # its table of thresholds names the experiments for docs/thresholds.md
            named = [
                text for text in texts(ast.parse(path.read_text(encoding="utf-8"))) if ".md" in text or "docs/" in text
            ]
            assert named == [], path
