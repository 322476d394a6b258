"""A virtual environment for tests that install packages: made, used and thrown away beside the one they run in."""

from __future__ import annotations

import os
import site
import subprocess
import venv
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Environment:
    """A virtual environment that sees the packages of the one the tests run in, and this copy of topokit."""

    folder: Path

    @classmethod
    def make(cls, folder: Path) -> Environment:
        venv.create(folder, with_pip=False, symlinks=True)
        environment = cls(folder)
        own = environment.python("-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip()
        seen = "; ".join(f"site.addsitedir({path!r})" for path in site.getsitepackages())
        (Path(own) / "packages_of_the_tests.pth").write_text(f"import site; {seen}\n")
        return environment

    def python(self, *arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        command = [str(self.folder / "bin" / "python"), *map(str, arguments)]
        variables = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=240, env=variables, cwd=cwd)

    def install(self, package: Path) -> None:
        """With what is there already: nothing is fetched."""
        self._pip("install", "--no-deps", "--no-build-isolation", package)

    def uninstall(self, name: str) -> None:
        self._pip("uninstall", "--yes", name)

    def topokit(self, *arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        return self.python("-m", "topokit", *arguments, cwd=cwd)

    def pytest(self, tests: Path) -> subprocess.CompletedProcess[str]:
        return self.python("-m", "pytest", "-q", "-p", "no:cacheprovider", tests, cwd=tests)

    def _pip(self, *arguments: object) -> None:
        found = self.python("-m", "pip", "--disable-pip-version-check", *arguments)
        assert found.returncode == 0, found.stderr
