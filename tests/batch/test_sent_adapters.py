"""Adapters that a script registers are known to the processes that examine its files, or refused before they start."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import topokit as tk
from topokit.plugins import registry, sending

SCRIPT = """
import torch
import topokit as tk
from topokit.testing import genus_mesh
from rooms import Rooms

def shape_of(path):
    return tk.from_mesh(genus_mesh(int(path.read_text())))

@tk.register_adapter("handles", suffixes=(".handles",))
def open_handles(path, *, more: int = 0):
    return shape_of(path)

class Doors(tk.Adapter):
    name, description, suffixes = "doors", "doors", (".door",)

    def can_open(self, source):
        return source.name == "door"

    def open(self, source):
        return shape_of(source)

tk.register_adapter(Doors)
tk.register_adapter(Rooms)

def shapes_of(radius):
    small = {"resolution": 128, "n_samples": 300, "field_resolution": 16}
    ball = tk.from_sdf(lambda p: p.norm(dim=1) - radius, **small)
    ring = tk.from_sdf(lambda p: torch.hypot(p[:, :2].norm(dim=1) - 0.6, p[:, 2]) - radius / 2, **small)
    return [ball.replace(name="own/a ball"), ring.replace(name="own/a ring")]

for row in sorted(tk.survey([*shapes_of(0.5), "files"], jobs=2), key=lambda row: row["file"]):
    print(row["file"].partition("/")[2], row["adapter"], row["genus"], row["error"])
"""
ROOMS = """
from topokit import Adapter
from topokit.testing import genus_mesh

class Rooms(Adapter):
    name, description, suffixes = "rooms", "rooms", (".room",)

    def open(self, source):
        import topokit as tk
        return tk.from_mesh(genus_mesh(int(source.read_text())))
"""


@pytest.fixture
def one_worker() -> Iterator[Any]:
    """A client of one process, which must see every adapter that is sent."""
    pytest.importorskip("distributed")
    from topokit.batch.files_on_dask import connected

    with connected("local", 1) as client:
        yield client


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_registered", dict(registry.BUILT_IN))
    monkeypatch.setattr(sending, "_agreed", b"")


def test_processes_know_the_adapters_and_functions_of_a_script(tmp_path: Path) -> None:
    files = tmp_path / "files"
    files.mkdir()
    for genus, name in ((1, "a.handles"), (2, "b.room"), (3, "door")):
        (files / name).write_text(str(genus))
    (tmp_path / "rooms.py").write_text(ROOMS)
    (tmp_path / "script.py").write_text(SCRIPT)
    ran = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=250)
    found = ["a.handles handles 1 None", "b.room rooms 2 None", "door doors 3 None"]
    assert ran.stdout.splitlines() == [*found, "a ball None 0 None", "a ring None 1 None"], ran


def handles(path: Path) -> tk.Shape:
    """This module is none that another process could import."""
    from topokit.testing import genus_mesh

    return tk.from_mesh(genus_mesh(int(path.read_text())))


def test_workers_of_a_cluster_know_them_too(tmp_path: Path, one_worker: Any, registered: None) -> None:
    (tmp_path / "a.handles").write_text("2")
    for genus_of_all in (None, 4):  # a second one replaces the first one, which workers have kept

        @tk.register_adapter("handles", suffixes=(".handles",), overwrite=True)
        def open_it(path: Path, number: int | None = genus_of_all) -> tk.Shape:
            """Handles."""
            if number is not None:
                path.write_text(str(number))
            return handles(path)

        (row,) = tk.survey(tmp_path, client=one_worker).rows
        assert (row["genus"], row["error"]) == (genus_of_all or 2, None)
    sent = sending.packed_adapters()
    del registry._registered["handles"]
    (row,) = tk.survey([tmp_path / "a.handles"], client=one_worker).rows
    assert "a.handles" in row["error"]
    assert row["genus"] is None
    assert sent != sending.packed_adapters()


def test_built_in_adapters_are_replaced_and_come_back(registered: None) -> None:
    tk.register_adapter("mesh", handles, suffixes=(".handles",), overwrite=True)
    content = sending.packed_adapters()
    registry._registered.clear()
    registry._registered.update(registry.BUILT_IN)
    sending._agreed = b""
    sending.know_adapters(content)
    (mesh,) = (one for one in tk.list_adapters() if one.name == "mesh")
    assert mesh.suffixes == (".handles",)
    registry._registered, of_script = dict(registry.BUILT_IN), registry._registered
    nothing = sending.packed_adapters()
    registry._registered, sending._agreed = of_script, content
    sending.know_adapters(nothing)
    assert registry._registered == registry.BUILT_IN


def test_what_cannot_be_sent_is_an_error_before_any_work(tmp_path: Path, registered: None) -> None:
    lock = threading.Lock()

    @tk.register_adapter("locked", suffixes=(".locked",))
    def open_it(path: Path) -> tk.Shape:
        """Locks."""
        with lock:
            return handles(path)

    (tmp_path / "a.locked").write_text("2")
    assert tk.survey(tmp_path)[0]["genus"] == 2
    with pytest.raises(tk.InputError, match=r"adapter 'locked' .* cannot be sent .*lock.* pass jobs=1"):
        list(tk.survey(tmp_path, jobs=2))


def test_what_cannot_be_made_there_says_so() -> None:
    content = sending.pickle.dumps({"gone": b"cgone_module\nGone\n."})
    with pytest.raises(tk.AdapterError, match=r"adapter 'gone' of the calling process .*No module named 'gone_module'"):
        sending.know_adapters(content)


def test_shapes_that_cannot_be_sent_are_named() -> None:
    lock = threading.Lock()
    locked = tk.from_sdf(lambda p: p.norm(dim=1) - (0.5 if lock else 0.6)).replace(name="locked")
    with pytest.raises(tk.InputError, match=r"locked cannot be sent to another process .*lock.* pass jobs=1"):
        list(tk.survey([locked, locked], jobs=2))
