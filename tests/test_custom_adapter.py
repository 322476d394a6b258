"""The example plug-in, installed by pip beside topokit in an environment of its own, used, and uninstalled again."""

from __future__ import annotations

import json
import os
import shutil
import site
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "custom_adapter"
RING = EXAMPLE / "ring.metaballs"


@dataclass(frozen=True)
class Environment:
    """A virtual environment that sees the packages of the one the tests run in, and this copy of topokit."""

    folder: Path

    def python(self, *arguments: object) -> subprocess.CompletedProcess[str]:
        command = [str(self.folder / "bin" / "python"), *map(str, arguments)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=240, env=environment)

    def pip(self, *arguments: object) -> None:
        found = self.python("-m", "pip", "--disable-pip-version-check", *arguments)
        assert found.returncode == 0, found.stderr

    def topokit(self, *arguments: object) -> subprocess.CompletedProcess[str]:
        return self.python("-m", "topokit", *arguments)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=True)
    found = Environment(folder)
    own = found.python("-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip()
    seen = "; ".join(f"site.addsitedir({path!r})" for path in site.getsitepackages())
    (Path(own) / "packages_of_the_tests.pth").write_text(f"import site; {seen}\n")
    source = folder / "source"
    shutil.copytree(EXAMPLE, source)
    found.pip("install", "--no-deps", "--no-build-isolation", source)
    return found


def test_load_finds_it(environment: Environment) -> None:
    code = f"import topokit; print(topokit.__file__); print(topokit.load({str(RING)!r}, resolution=128).report())"
    found = environment.python("-c", code)
    place, answer, *_ = found.stdout.splitlines()
    assert place == str(ROOT / "topokit" / "__init__.py")
    assert answer == "ring.metaballs: Euler characteristic 0 (likely), genus 1, 1 component, closed"


def test_the_command_line_finds_it(environment: Environment) -> None:
    found = environment.topokit("report", "--json", RING)
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)[0]["genus"] == 1
    assert "metaballs\t.metaballs\tusable" in environment.topokit("adapters").stdout.splitlines()


def test_its_own_tests_pass(environment: Environment) -> None:
    found = environment.python("-m", "pytest", "-q", "-p", "no:cacheprovider", environment.folder / "source" / "tests")
    assert found.returncode == 0, found.stdout
    assert " passed" in found.stdout


def test_uninstalled_it_is_gone(environment: Environment) -> None:
    environment.pip("uninstall", "--yes", "topokit-metaballs")
    try:
        found = environment.topokit("report", RING)
        assert found.returncode == 1
        assert f"{RING}: '.metaballs' is not a known format and its content is not one either." in found.stderr
        assert "metaballs" not in environment.topokit("adapters").stdout
    finally:
        environment.pip("install", "--no-deps", "--no-build-isolation", environment.folder / "source")


def test_the_environment_of_the_tests_is_left_alone(environment: Environment) -> None:
    code = "import importlib.util; print(importlib.util.find_spec('topokit_metaballs'))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert found.stdout.strip() == "None"
