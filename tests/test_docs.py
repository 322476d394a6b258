"""The documentation is true: every program runs, the site builds without a warning, the reference is complete."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import topokit as tk

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
INDEX = (DOCS / "index.md").read_text(encoding="utf-8")
RUN_ELSEWHERE = {"adapters.md", "topology-loss.md"}  # by test_adapter_docs.py and test_readme.py


def programs(page: Path) -> list[str]:
    """The Python blocks of a page, which share their names."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


PAGES = [page for page in sorted(DOCS.glob("*.md")) if programs(page) and page.name not in RUN_ELSEWHERE]


def test_pages_with_programs_are_found() -> None:
    assert {"howto-print.md", "pages.md", "quickstart.md", "verdict.md"} <= {page.name for page in PAGES}


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


EVIDENCE = re.findall(r"[\w-]+", INDEX.partition("## Evidence")[2].rpartition("```")[0].rpartition("\n\n")[2])
GENERATED = {"gallery.md"}
READ = [page for page in sorted(DOCS.glob("*.md")) if page.stem not in EVIDENCE and page.name not in GENERATED]


def sentences(page: Path) -> list[str]:
    """The sentences of a page, without headings, tables, pictures and code; each item of a list begins a new one."""
    text = re.sub(
        r"^(`{3,}).*?^\1|!\[[^]]*\]\([^)]*\)", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    text = re.sub(r"^(#|\|).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"`[^`]*`", "code", re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text))
    blocks = re.split(r"\n\s*\n|^\s*(?:-|\d+\.) ", text, flags=re.MULTILINE)
    return [one for block in blocks for one in re.split(r"(?<=[.!?])\s+", " ".join(block.split())) if " " in one]


@pytest.mark.parametrize("page", [ROOT / "README.md", *READ], ids=lambda page: page.name)
def test_pages_for_users_are_easy_to_read(page: Path) -> None:
    """On average at most 18 words in a sentence, the subject first, and no history of the development."""
    found = sentences(page)
    assert sum(len(one.split()) for one in found) <= 18 * max(len(found), 1)
    assert [one for one in found if len(one.split()) > 45] == []
    assert [one for one in found if re.match(r"Of (a|an|the|such|all|these|those|any)\b", one)] == []
    assert [one for one in found if re.search(r"\b(an earlier version|no longer|used to be|predates?)\b", one)] == []


def test_every_page_is_in_the_menu() -> None:
    assert {"accuracy", "thresholds", "fuzzing"} <= set(EVIDENCE)
    assert set(re.findall(r"^([a-z-]+)$", INDEX, re.MULTILINE)) == {page.stem for page in DOCS.glob("*.md")} - {"index"}


def test_the_reference_lists_every_public_name() -> None:
    listed = re.findall(
        r"^\.\. auto\w+:: topokit\.([\w.]+)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    listed = [name.removeprefix("questions.") for name in listed]  # the package report has the name of a function
    names = [name for name in tk.__all__ if name not in ("export", "losses", "metrics", "pages", "testing")]
    assert sorted(name for name in listed if "." not in name) == names
    losses = {name for name in tk.losses.__all__ if name not in tk.__all__}
    assert {name.removeprefix("losses.") for name in listed if name.startswith("losses.")} == losses
