"""The documentation is true: every program runs, the site builds without a warning, the reference is complete."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import topokit as tk

DOCS = Path(__file__).resolve().parents[1] / "docs"
RUN_ELSEWHERE = {"adapters.md", "topology-loss.md"}  # by test_adapter_docs.py and test_readme.py


def programs(page: Path) -> list[str]:
    """The Python blocks of a page, which share their names."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


PAGES = [page for page in sorted(DOCS.glob("*.md")) if programs(page) and page.name not in RUN_ELSEWHERE]


def test_pages_with_programs_are_found() -> None:
    assert {"pages.md", "quickstart.md", "recipes.md", "verdict.md"} <= {page.name for page in PAGES}


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_programs_of_a_page_run(page: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-X", "utf8", "-W", "error::RuntimeWarning", "-c", "\n".join(programs(page))]
    ran = subprocess.run(command, capture_output=True, cwd=tmp_path, text=True, encoding="utf-8")
    assert ran.returncode == 0, ran.stderr


@pytest.mark.long
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    for name in ("furo", "myst_parser", "sphinx", "sphinx_copybutton"):
        pytest.importorskip(name, reason="the documentation needs the extra docs")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", tmp_path / "trees", DOCS, tmp_path]
    built = subprocess.run([str(word) for word in command], capture_output=True, text=True, encoding="utf-8")
    assert built.returncode == 0, built.stderr
    for page in DOCS.glob("*.md"):
        assert (tmp_path / page.with_suffix(".html").name).is_file()
    assert 'id="topokit.Shape.save_html"' in (tmp_path / "api.html").read_text(encoding="utf-8")


def test_the_reference_lists_every_public_name() -> None:
    listed = re.findall(
        r"^\.\. auto\w+:: topokit\.([\w.]+)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    names = [name for name in tk.__all__ if name not in ("losses", "testing")]
    assert sorted(name for name in listed if "." not in name) == names
    losses = {name for name in tk.losses.__all__ if name not in tk.__all__}
    assert {name.removeprefix("losses.") for name in listed if name.startswith("losses.")} == losses
