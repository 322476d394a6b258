"""One shape: its picture, its page, and what a notebook shows of it, whatever the shape is."""

from __future__ import annotations

import html
import re
import sys
import types
import webbrowser
from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.pages.single import View
from topokit.testing import sphere_samples, torus_mesh

NAME = "<script>alert(1)</script>"


def test_a_picture_has_the_size_asked_for_and_shows_the_side_that_faces_the_eye() -> None:
    shape = tk.from_mesh(torus_mesh())
    above, beside = (shape.picture(80, eye=eye) for eye in ((0.0, 0.01, 1.0), (1.0, 0.0, 0.0)))
    assert above.size == beside.size == (80, 80)
    hole = np.asarray(above)[38:42, 38:42]
    assert (hole == 255).all(), "the hole of the torus from above"
    assert (np.asarray(beside)[38:42, 38:42] < 255).all()
    assert shape.picture(80, eye=(1.0, 0.0, 0.0)).tobytes() == beside.tobytes(), "the same picture again"


def test_a_page_of_one_shape_is_written(tmp_path: Path) -> None:
    tk.from_mesh(torus_mesh()).replace(name=NAME).save_html(tmp_path / "torus.html")
    page = (tmp_path / "torus.html").read_text(encoding="utf-8")
    assert html.escape(NAME) in page
    assert NAME not in page
    assert page.count('id="scene-') == 1


@pytest.mark.parametrize("kind", ["mesh", "points", "volume", "network", "batch", "plane"])
def test_a_notebook_shows_any_shape(kind: str) -> None:
    points = sphere_samples(400).points
    axis = torch.linspace(-1, 1, 16)
    ball = 0.7 - torch.cartesian_prod(axis, axis, axis).norm(dim=1).reshape(16, 16, 16)
    shape = {
        "mesh": lambda: tk.from_mesh(torus_mesh()),
        "points": lambda: tk.from_points(points),
        "volume": lambda: tk.from_voxels(ball, level=0.0),
        "network": lambda: tk.from_sdf(lambda p: p.norm(dim=1) - 0.5),
        "batch": lambda: tk.from_points(torch.stack([points] * 2)),
        "plane": lambda: tk.from_points(points * torch.tensor([1.0, 1.0, 0.0])),
    }[kind]()
    text = shape.replace(name=NAME)._repr_html_()
    assert html.escape(NAME) in text
    assert "<script" not in text
    assert ("<img" in text) == (kind in ("mesh", "points", "plane"))


def test_a_notebook_shows_a_report_with_what_decided_first() -> None:
    report = tk.from_mesh(torus_mesh()).replace(name=NAME, notes=(NAME,)).report()
    text = report._repr_html_()
    assert NAME not in text
    assert re.search(r'<li class="deciding certain"[^>]*><b>Every edge', text)
    assert text.index("Every edge") < text.index(html.escape(NAME))


def test_show_opens_a_tab_outside_of_notebooks(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open_new_tab", opened.append)
    assert tk.from_mesh(torus_mesh()).show() is None
    assert Path(opened[0].removeprefix("file://")).read_text(encoding="utf-8").startswith("<!doctype html>")


def test_show_gives_a_frame_in_notebooks(monkeypatch: pytest.MonkeyPatch) -> None:
    shell = types.SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    view = tk.from_mesh(torus_mesh()).show()
    assert isinstance(view, View)
    frame = view._repr_html_()
    held = re.fullmatch(r'<iframe sandbox="allow-scripts" [^>]*srcdoc="([^"]*)"></iframe>', frame)
    assert held is not None
    assert html.unescape(held.group(1)) == view.page
