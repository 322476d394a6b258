"""The page of a comparison in a browser: colors and words of both solids, and clicks that find what differs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from browser import opened_browser, page_in
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.comparison.page import entry_of

TRUTH = np.zeros((24, 20, 12), bool)
TRUTH[2:14, 2:18, 3:9] = True
TRUTH[6:10, 8:12] = False  # a tunnel
PREDICTION = TRUTH.copy()
PREDICTION[6:10, 8:12, 5:7] = True  # which is filled,
PREDICTION[18:22, 4:8, 4:8] = True  # and a part too many
NEAR = """place => document.getElementById("canvas").dataset.target.split(",").every(
    (x, axis) => Math.abs(x - place[axis]) < 0.1)"""


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    for name, volume in (("prediction", PREDICTION), ("truth", TRUTH)):
        np.save(tmp_path / f"{name}.npy", volume.astype(np.uint8))
    return tmp_path / "prediction.npy", tmp_path / "truth.npy"


def test_a_click_finds_what_differs(tmp_path: Path) -> None:
    tk.compare(PREDICTION, TRUTH).save_html(tmp_path / "page.html")
    with opened_browser() as browser, page_in(browser) as (page, complaints):
        page.goto((tmp_path / "page.html").as_uri())
        page.wait_for_selector("#canvas[data-target]")
        assert [page.locator("#legend").text_content()] == ["Solidtruth onlybothjudged only"]
        assert page.text_content("#details .verdict") == "different topology"
        page.click("#details >> text=missing filled tunnel")
        page.wait_for_selector("#canvas[data-chosen='0']")
        page.click("#details >> text=spurious extra part")
        page.wait_for_function(NEAR, arg=[19.5, 5.5, 5.5])
        assert complaints == []


def test_colors_tell_whose_a_place_is() -> None:
    fragment = entry_of(tk.compare(PREDICTION, TRUTH), "pair").fragment
    assert (fragment.facts["verdict"], fragment.facts["missing1"], fragment.facts["spurious0"]) == ("different", 1, 1)
    assert fragment.facts["reason"].startswith("spurious extra part")
    same = entry_of(tk.compare(TRUTH, TRUTH), "pair").fragment
    assert (same.facts["verdict"], same.facts["matched1"], same.facts["reason"]) == ("same", 1, "")
    nothing = entry_of(tk.compare(TRUTH & False, TRUTH & False), "pair").fragment
    assert nothing.scene is None


def test_the_command_writes_a_page_beside_its_lines(files: tuple[Path, Path], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    found = CliRunner().invoke(app, ["compare", *map(str, files), "--json", "--html", str(page)])
    assert (found.exit_code, json.loads(found.stdout)[0]["missing"]) == (0, [0, 1, 0])
    text = page.read_text(encoding="utf-8")
    assert "missing filled tunnel" in text
    assert '<th data-key="spurious1">spurious 1</th>' in text
    wrong = CliRunner().invoke(app, ["compare", *map(str, files), "--html", str(tmp_path / "page.txt")])
    assert (wrong.exit_code, wrong.stdout) == (2, "")
