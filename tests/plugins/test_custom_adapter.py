"""The example plug-in, installed by pip beside topokit in an environment of its own, used, and uninstalled again."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys

import pytest
from environments import ROOT, Environment

EXAMPLE = ROOT / "examples" / "custom_adapter"
RING = EXAMPLE / "ring.metaballs"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    folder = tmp_path_factory.mktemp("environment")
    found = Environment.make(folder)
    shutil.copytree(EXAMPLE, folder / "source")
    found.install(folder / "source")
    return found


def test_load_finds_it(environment: Environment) -> None:
    code = f"import topokit; print(topokit.__file__); print(topokit.load({str(RING)!r}, resolution=128).report())"
    found = environment.python("-c", code)
    place, answer, *_ = found.stdout.splitlines()
    assert place == str(ROOT / "topokit" / "__init__.py")
    assert answer.startswith("ring.metaballs: Euler characteristic 0 (likely, for features wider than 0.")
    assert answer.endswith("), genus 1, 1 component, closed")


@pytest.mark.long
def test_the_command_line_finds_it(environment: Environment) -> None:
    found = environment.topokit("report", "--json", RING)
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)[0]["genus"] == 1
    assert "metaballs\t.metaballs\tusable" in environment.topokit("adapters").stdout.splitlines()


@pytest.mark.long
def test_its_own_tests_pass(environment: Environment) -> None:
    found = environment.pytest(environment.folder / "source")
    assert found.returncode == 0, found.stdout
    assert " passed" in found.stdout


@pytest.mark.long
def test_uninstalled_it_is_gone(environment: Environment) -> None:
    environment.uninstall("topokit-metaballs")
    try:
        found = environment.topokit("report", RING)
        assert found.returncode == 1
        assert f"{RING}: '.metaballs' is not a known format, and its content is not one either." in found.stderr
        assert "metaballs" not in environment.topokit("adapters").stdout
    finally:
        environment.install(environment.folder / "source")


def test_the_environment_of_the_tests_is_left_alone(environment: Environment) -> None:
    code = "import importlib.util; print(importlib.util.find_spec('topokit_metaballs'))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert found.stdout.strip() == "None"
