"""The README and the generated pages agree with the code: programs run and print what is shown, lists are complete."""

from __future__ import annotations

import doctest
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest
import torch

import topokit as tk

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PICTURES = ROOT / "docs" / "pictures"
DOCS = ROOT / "docs"
NAMES = (DOCS / "api.md").read_text(encoding="utf-8").partition("## Public names")[2].partition("\n## ")[0]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "examples").rglob("*.md")])
PROGRAMS = re.findall(r"^```python\n(.*?)^```\n\n```text\n(.*?)^```", README, re.DOTALL | re.MULTILINE)


def module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = loaded
    spec.loader.exec_module(loaded)
    return loaded


def test_every_program_of_the_readme_shows_its_output() -> None:
    assert len(PROGRAMS) == README.count("```python") == 3


def test_the_readme_is_a_front_door() -> None:
    assert len(README.encode()) <= 8000


@pytest.mark.parametrize(("program", "shown"), PROGRAMS, ids=["six lines", "topology loss", "adapter"])
def test_the_programs_of_the_readme_run_and_print_what_is_shown(
    program: str, shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    exec(compile(program, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert doctest.OutputChecker().check_output(shown, printed, doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE), (
        printed
    )


def test_the_first_program_of_the_topology_loss_closes_its_hole(capsys: pytest.CaptureFixture[str]) -> None:
    page = ROOT / "docs" / "topology-loss.md"
    code = re.search(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    exec(compile(code.group(1), str(page), "exec"), {})
    assert "euler=2, components=1, tunnels=0, cavities=0" in capsys.readouterr().out


def test_the_readme_quotes_the_measured_shares() -> None:
    """Every "n of N" of its table, and the wrong "likely" answers, are those of docs/accuracy.md."""
    accuracy = (DOCS / "accuracy.md").read_text(encoding="utf-8")
    measured = dict(re.findall(r"^\| ([\w ]+?)(?:, by counting)? \| (\d+ / \d+) \|", accuracy, re.MULTILINE))
    quoted = dict(re.findall(r"^\| (?:Gaussian )?([\w ]+?) \|.*\| (\d+ of \d+)(?: networks)? \|", README, re.MULTILINE))
    assert len(quoted) == 5
    assert {name: share.replace(" of ", " / ") for name, share in quoted.items()}.items() <= measured.items()
    draws = re.findall(r"\| (\d+) of (\d+) \|$", accuracy, re.MULTILINE)
    wrong, likely = (sum(int(pair[number]) for pair in draws) for number in range(2))
    assert re.findall(r"draws, (\d+) of (\d+)\s+(?:was|were) wrong", README) == [(str(wrong), str(likely))]


def test_the_reference_lists_every_public_name_once() -> None:
    in_first_column = re.findall(r"`([A-Za-z_]+)`", " ".join(re.findall(r"^\| ([^|]*) \|", NAMES, re.MULTILINE)))
    assert sorted(in_first_column) == sorted(tk.__all__)


def test_the_reference_lists_every_question_to_a_shape() -> None:
    names = {*dir(tk.Shape), *(name for base in tk.Shape.__mro__ for name in vars(base).get("__annotations__", ()))}
    assert {name for name in names if not name.startswith("_")} == set(re.findall(r"`\.([a-z_]+)", NAMES))


def test_the_page_of_formats_lists_every_suffix() -> None:
    listed = set(
        re.findall(r"(?<=[ `])\.[a-z0-9]+(?:\.gz)?(?=[ `])", (DOCS / "formats.md").read_text(encoding="utf-8"))
    )
    built_in = [adapter for adapter in tk.list_adapters() if "topokit" in str(adapter.opener)]
    assert listed >= {suffix for adapter in built_in for suffix in adapter.suffixes}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)(?:#([^)]*))?\)", text):
        linked = page.parent / target if target else page
        assert linked.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.*)$", linked.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in [heading.lower().replace(" ", "-") for heading in headings]


def test_the_page_of_thresholds_is_up_to_date() -> None:
    generator = module(ROOT / "docs" / "make_thresholds.py")
    shown = (ROOT / "docs" / "thresholds.md").read_text(encoding="utf-8")
    assert shown == generator.page(), "run python docs/make_thresholds.py"


def test_the_overview_shows_a_volume_and_its_report() -> None:
    overview = module(PICTURES / "make_overview.py")
    axis = torch.linspace(-1, 1, 16)
    image, shape = overview.volume_panel(
        "a ball", 0.7 - torch.cartesian_prod(axis, axis, axis).norm(dim=1).reshape(16, 16, 16)
    )
    assert image.shape == (overview.SIDE, overview.SIDE, 3)
    middle = overview.SIDE // 2
    assert image[middle, middle].min() < 255
    assert str(shape.report()).startswith(
        "a ball: 1 piece, 0 tunnels, 0 cavities (χ of the solid 1, of its surface 2), certain"
    )
    assert (PICTURES / "overview.png").stat().st_size <= 200_000
