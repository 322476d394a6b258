"""`make test` installs system packages only where it may."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / ".ci" / "system-libraries"


@pytest.mark.skipif(os.name != "posix", reason="the script is for Debian and the like")
@pytest.mark.parametrize(("system", "asks"), [("yes", True), ("no", False)])
def test_packages_are_installed_unless_system_is_no(system: str, asks: bool, tmp_path: Path) -> None:
    """On a machine where the user is root and no library is there, by programs that only say what they were asked."""
    for name, answer in (("ldconfig", ""), ("id", "echo 0"), ("apt-get", f'echo "$@" >>{tmp_path}/asked')):
        (tmp_path / name).write_text(f"#!/bin/sh\n{answer}\n")
        (tmp_path / name).chmod(0o755)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SYSTEM": system}
    subprocess.run(["sh", str(SCRIPT)], env=environment, check=True)
    asked = tmp_path / "asked"
    assert asked.exists() == asks
    assert not asks or "libegl1" in asked.read_text()
