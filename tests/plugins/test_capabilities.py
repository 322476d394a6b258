"""What a plug-in declares is used wherever built-in adapters have it: labels, folders, addresses, clusters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import topokit as tk
from topokit.batch.sources import find_sources
from topokit.errors import AdapterError, InputError
from topokit.plugins import registry
from topokit.testing import sphere_samples, torus_samples


def ball(n_points: int = 300) -> tk.Shape:
    known = sphere_samples(n_points)
    return tk.Shape(tk.SurfaceSamples(known.points, known.normals))


class Balls(tk.Adapter):
    """Files of words; every word is a shape."""

    name, description, suffixes = "balls", "balls", (".txt", ".balls")
    priority = 1
    addresses = (".balls",)

    def may_open(self, path: Path) -> bool:
        return path.read_text().startswith("ball")

    def is_large(self, source: Path | str, options: Mapping[str, Any]) -> bool:
        return bool(options["n_points"] > 1000)

    def open(self, source: Path | str, *, n_points: int = 300, client: Any = None) -> tk.Shape:
        return ball(n_points).replace(name=type(source).__name__)

    def open_labels(self, source: Path, labels: Any, *, n_points: int = 300) -> dict[int, tk.Shape]:
        torus = torus_samples(n_points)
        shapes = {1: ball(n_points), 2: tk.Shape(tk.SurfaceSamples(torus.points, torus.normals))}
        return {label: shapes[label] for label in (shapes if labels == "all" else labels)}


@pytest.fixture
def balls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder with a file of balls and one of prose; the adapter is registered meanwhile."""
    monkeypatch.setattr(registry, "_registered", dict(registry.BUILT_IN))
    tk.register_adapter(Balls)
    (tmp_path / "a.txt").write_text("ball ball")
    (tmp_path / "notes.txt").write_text("nothing to see")
    return tmp_path


def test_folders_ask_whether_a_file_may_be_one(balls: Path) -> None:
    found = find_sources(balls)
    assert [Path(source.name).name for source in found.sources] == ["a.txt"]
    assert [Path(name).name for name in found.passed_over] == ["notes.txt"]


def test_a_broken_answer_costs_a_warning_not_the_file(balls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Balls, "may_open", lambda self, path: 1 / 0)
    monkeypatch.setattr("topokit.plugins.adapter_choice.warn_once", lambda name, message: messages.append(message))
    messages: list[str] = []
    assert len(find_sources(balls).sources) == 2
    assert "ZeroDivisionError" in messages[0]


def test_labels_are_rows(balls: Path) -> None:
    rows = tk.survey(balls / "a.txt", labels=[2, 1], n_points=400).rows
    assert [(row["label"], row["adapter"]) for row in rows] == [(2, "balls"), (1, "balls")]
    (row,) = tk.survey(balls / "a.txt", labels="all", color="red").rows
    assert "no color=…" in row["error"]
    (row,) = tk.survey(balls / "a.txt", labels=[3]).rows
    assert "open_labels of adapter 'balls' failed" in row["error"]
    assert "KeyError" in row["error"]


def test_an_address_that_it_declares_is_not_copied(balls: Path) -> None:
    pytest.importorskip("fsspec")
    (balls / "some.balls").mkdir()
    (balls / "some.balls" / "a").touch()
    assert tk.load((balls / "some.balls" / "a").as_uri()).name == "str"
    assert tk.load((balls / "a.txt").as_uri(), adapter="balls").name != "str"
    assert registry.opens_address("s3://bucket/some.balls", "balls")
    assert not registry.opens_address("s3://bucket/some.balls", "points")
    assert not registry.opens_address("s3://bucket/some.txt")


def test_large_files_are_shared(balls: Path) -> None:
    assert registry.shared_by_workers(balls / "a.txt", "balls", {"n_points": 2000})
    assert not registry.shared_by_workers(balls / "a.txt", "balls", {"n_points": 20})
    assert not registry.shared_by_workers(balls / "a.txt", "mesh", {})
    with pytest.raises(AdapterError, match=r"is_large of adapter 'balls' failed for .*a.txt \(KeyError"):
        registry.shared_by_workers(balls / "a.txt", "balls", {})


@pytest.mark.parametrize(
    ("attribute", "value"),
    [("addresses", "zarr"), ("open_labels", 3), ("is_large", "nowhere"), ("may_open", True), ("shows_progress", 1)],
)
def test_wrong_declarations_are_named(balls: Path, attribute: str, value: object) -> None:
    with pytest.raises(AdapterError, match=rf"its {attribute} (is|are) {value!r}; expected"):
        tk.register_adapter("other", lambda source: ball(), description="other", **{attribute: value})


def test_no_labels_without_a_function_for_them(balls: Path) -> None:
    with pytest.raises(InputError, match=r"'mesh' opens no labels; 'voxels' and 'balls'"):
        registry.load_labels(balls / "a.txt", "all", "mesh")
