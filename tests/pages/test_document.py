"""A page is complete or absent, needs nothing else, escapes what it shows, and takes entries as they come."""

from __future__ import annotations

import base64
import hashlib
import pickle
import re
import weakref
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.errors import InputError
from topokit.pages import Entry, Fragment, page_of, write_html
from topokit.testing import sphere_samples, torus_mesh
from topokit.text import printable

HOSTILE = '</td></template><script>alert("1")</script><img src=x onerror=alert(2)>&amp;\u202e.obj'
VIEWER = Path(tk.__file__).parent / "pages" / "static" / "viewer.min.js"
SOURCES = Path(__file__).resolve().parents[2] / "web" / "src"


class Seen(HTMLParser):
    """Tags with their attributes, and the text outside scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@pytest.fixture(scope="module")
def fragment() -> Fragment:
    shape = tk.from_mesh(torus_mesh(24, 12)).replace(name=HOSTILE, notes=(HOSTILE,))
    return page_of(shape, shape.report())


def test_the_page_needs_no_other_file(fragment: Fragment, tmp_path: Path) -> None:
    write_html([Entry("torus", fragment, seconds=0.5)], tmp_path / "page.html")
    seen = Seen((tmp_path / "page.html").read_text(encoding="utf-8"))
    for tag, attributes in seen.tags:
        assert tag not in ("link", "iframe", "base")
        assert not (tag == "script" and "src" in attributes)
        assert (attributes.get("src") or "data:").startswith("data:")
        assert (attributes.get("href") or "#").startswith("#")
    pictures = [attributes["src"] for tag, attributes in seen.tags if tag == "img"]
    assert len(pictures) == 1
    assert base64.b64decode(str(pictures[0]).partition(",")[2])[8:12] == b"WEBP"


def test_names_and_reasons_are_shown_as_they_are(fragment: Fragment, tmp_path: Path) -> None:
    entries = [Entry(HOSTILE, fragment), Entry(HOSTILE + "2", None, error=HOSTILE)]
    write_html(entries, tmp_path / "page.html", title=HOSTILE)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    seen = Seen(page)
    scripts = [attributes for tag, attributes in seen.tags if tag == "script"]
    assert [attributes.get("id") for attributes in scripts] == ["scene-1", None]
    assert sum(tag == "img" for tag, _ in seen.tags) == 1
    assert not any(name.startswith("on") for _, attributes in seen.tags for name in attributes)
    assert "".join(seen.words).count(printable(HOSTILE)) >= 6


def test_only_the_viewer_may_run(fragment: Fragment, tmp_path: Path) -> None:
    write_html([Entry("torus", fragment)], tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    allowed = re.search(r"script-src 'sha256-([^']+)'", page)
    assert allowed is not None
    script = page.rpartition("<script>")[2].partition("</script>")[0]
    assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() == allowed.group(1)


def test_files_that_failed_come_first(fragment: Fragment, tmp_path: Path) -> None:
    entries = [Entry("a", fragment), Entry("b", None, "b is empty"), Entry("c", fragment), Entry("d", None, "no d")]
    write_html(iter(entries), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    rows = re.findall(r'<tr id="row-(\d)".*?<a href="#shape-(\d)">(\w)</a>.*?class="reason">([^<]*)', page, re.DOTALL)
    assert [row[:3] for row in rows] == [("2", "2", "b"), ("4", "4", "d"), ("1", "1", "a"), ("3", "3", "c")]
    assert [row[3] for row in rows[:2]] == ["b is empty", "no d"]
    scenes = dict(re.findall(r'id="scene-(\d)">([^<]+)', page))
    assert scenes == dict.fromkeys("13", base64.b64encode(fragment.scene).decode())


def test_entries_are_not_kept(fragment: Fragment, tmp_path: Path) -> None:
    alive: list[weakref.ref[Fragment]] = []
    most = 0

    def entries() -> Iterator[Entry]:
        nonlocal most
        for number in range(20):
            one = replace(fragment)
            alive.append(weakref.ref(one))
            yield Entry(str(number), one)
            del one
            most = max(most, sum(reference() is not None for reference in alive))

    write_html(entries(), tmp_path / "page.html")
    assert most <= 3


def test_a_page_that_fails_leaves_the_old_one(fragment: Fragment, tmp_path: Path) -> None:
    target = tmp_path / "page.html"
    target.write_text("old")

    def entries() -> Iterator[Entry]:
        yield Entry("torus", fragment)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_html(entries(), target)
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize(("name", "message"), [("page.txt", "must be called"), ("no/page.html", "does not exist")])
def test_a_path_that_cannot_be_written_is_refused_at_once(name: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        write_html(iter(()), tmp_path / name)


def test_fragments_travel_between_processes_and_are_small(fragment: Fragment) -> None:
    packed = pickle.dumps(fragment)
    assert pickle.loads(packed) == fragment
    assert len(packed) < 200_000
    assert b"torch" not in packed


def test_a_shape_that_cannot_be_drawn_is_listed_with_the_reason() -> None:
    one = tk.from_points(sphere_samples(300).points)
    batch = tk.from_points(torch.stack([sphere_samples(300).points] * 2))
    found = page_of(batch, one.report())
    assert found.scene is found.thumbnail is None
    assert "one shape is drawn at a time" in found.details


def test_the_deciding_reasons_are_marked_and_first() -> None:
    vertices, faces = torus_mesh(24, 12)
    thrice = np.concatenate((faces, [[*faces[0, :2], faces[100, 0]]]))  # an edge with three faces, and boundary
    shape = tk.from_mesh((vertices, thrice)).replace(notes=("A note.",))
    report = shape.report()
    *lines, advice = str(report).splitlines()[1:]
    assert advice == f"  Advice: {report.advice}"
    assert [line[2] for line in lines] == ["*"] * report.n_deciding + ["-"] * (len(lines) - report.n_deciding)
    assert lines[:2] == [f"  * {reason}" for reason in report.reasons[:2]]
    assert "  - A note." in lines
    marked = re.findall(r'<li class="deciding unsure"[^>]*><b>(.*?)</b>', page_of(shape, report).details)
    assert len(marked) == report.n_deciding == 3
    assert "three or more faces" in marked[1]


def test_the_bundle_is_built_from_the_sources() -> None:
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(SOURCES.iterdir()))).hexdigest()
    assert f"sources {digest}" in VIEWER.read_text(encoding="utf-8")[:200], "run npm ci && npm run build in web/"
    assert "MIT" in VIEWER.with_name("THREE-LICENSE").read_text(encoding="utf-8")
