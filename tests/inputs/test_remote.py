"""Addresses instead of paths: memory://, zip:// and http:// are read as files are, within the same bounds."""

from __future__ import annotations

import json
import threading
import zipfile
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.inputs import remote
from topokit.inputs.remote import is_address, lies_in
from topokit.testing import genus_mesh, torus_samples

fsspec = pytest.importorskip("fsspec", reason="addresses need fsspec")


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    path = tmp_path / "part.off"
    tk.from_mesh(genus_mesh(2)).to_trimesh().export(path)
    return path


@pytest.fixture
def memory() -> Iterator[Any]:
    """A folder at memory://topokit, empty before and after."""
    system = fsspec.filesystem("memory")
    yield system
    if system.exists("/topokit"):
        system.rm("/topokit", recursive=True)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    """The address of a server of the temporary folder."""
    pytest.importorskip("aiohttp", reason="http:// needs aiohttp")

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None: ...

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path))) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{running.server_port}"
        running.shutdown()
        thread.join()


@pytest.mark.parametrize(
    ("text", "is_one", "is_zarr"),
    [
        ("s3://bucket/part.stl", True, False),
        ("https://example.org/volume.zarr?x=1", True, True),
        ("zip://a/v.zarr/0::s3://bucket/all.zip", True, True),
        ("simplecache::https://example.org/part.stl", True, False),
        ("C:\\parts\\part.stl", False, False),
        ("part.stl", False, False),
        ("a::b.stl", False, False),
        ("volume.zarr", False, False),
    ],
)
def test_what_is_an_address(text: str, is_one: bool, is_zarr: bool) -> None:
    assert (is_address(text), lies_in(text, (".zarr",))) == (is_one, is_zarr)


def test_files_in_memory(mesh: Path, memory: Any) -> None:
    memory.pipe("/topokit/part.off", mesh.read_bytes())
    for shape in (tk.load("memory://topokit/part.off"), tk.from_mesh("memory://topokit/part.off")):
        assert (shape.report().genus, shape.report().verdict, shape.name) == (2, "certain", "part.off")
    points = torus_samples(600).points.numpy()
    memory.pipe("/topokit/cloud.xyz", "\n".join(" ".join(map(str, point)) for point in points).encode())
    assert len(tk.from_points("memory://topokit/cloud.xyz").samples.points) == 600
    assert len(tk.from_points(points="memory://topokit/cloud.xyz").samples.points) == 600


def test_members_of_archives(mesh: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "parts.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(mesh, "inner/part.off")
        archive.writestr("inner/empty.off", "")
    assert tk.load(f"zip://inner/part.off::{tmp_path}/parts.zip").report().genus == 2
    for missing, said in (("inner/none.off", "does not exist"), ("inner", "is a folder"), ("inner/empty.off", "empty")):
        with pytest.raises(tk.ReadError, match=said):
            tk.load(f"zip://{missing}::{tmp_path}/parts.zip")


def test_bombs_in_archives_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("part.off", bytes(1 << 22))
    monkeypatch.setattr(remote, "FREE_OF_MASKS", 1 << 20)
    with pytest.raises(tk.ReadError, match="decompression bomb"):
        tk.load(f"zip://part.off::{tmp_path}/bomb.zip")


def test_a_copy_takes_at_most_half_of_the_free_disk(mesh: Path, memory: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    memory.pipe("/topokit/part.off", mesh.read_bytes())
    size = mesh.stat().st_size
    monkeypatch.setattr(remote.shutil, "disk_usage", lambda _: SimpleNamespace(free=2 * size))
    assert tk.load("memory://topokit/part.off").report().genus == 2
    monkeypatch.setattr(remote.shutil, "disk_usage", lambda _: SimpleNamespace(free=2 * size - 2))
    with pytest.raises(tk.ReadError, match=r"half of the \d+ bytes that are free"):
        tk.load("memory://topokit/part.off")


def test_no_copy_is_left(mesh: Path, memory: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    memory.pipe("/topokit/part.off", mesh.read_bytes())
    memory.pipe("/topokit/..", b"OFF 1 0 0")
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    tk.load("memory://topokit/part.off").report()
    for odd in ("memory://topokit/none.off", "memory://topokit/"):
        with pytest.raises(tk.ReadError, match="memory://topokit/"):
            tk.load(odd)
    assert list(folder.iterdir()) == []


def test_a_copy_has_no_neighbors(memory: Any, tmp_path: Path) -> None:
    """Nothing is fetched, or opened, that a file names."""
    buffer = {"byteLength": 36, "uri": "memory://topokit/buffer.bin"}
    memory.pipe("/topokit/buffer.bin", bytes(36))
    for uri in (buffer["uri"], "buffer.bin", "../buffer.bin"):
        scene = {"asset": {"version": "2.0"}, "buffers": [{**buffer, "uri": uri}]}
        memory.pipe("/topokit/scene.gltf", json.dumps(scene).encode())
        with pytest.raises(tk.ReadError):
            tk.load("memory://topokit/scene.gltf")


def test_files_of_a_server(mesh: Path, server: str, tmp_path: Path) -> None:
    assert tk.load(f"{server}/part.off?token=1").report().genus == 2
    with pytest.raises(tk.ReadError, match="does not exist"):
        tk.load(f"{server}/none.off")
    with zipfile.ZipFile(tmp_path / "parts.zip", "w") as archive:
        archive.write(mesh, "part.off")
    assert tk.load(f"zip://part.off::simplecache::{server}/parts.zip").report().genus == 2


def test_a_server_that_does_not_answer() -> None:
    pytest.importorskip("aiohttp", reason="http:// needs aiohttp")
    with pytest.raises(tk.ReadError, match=r"127\.0\.0\.1:9"):
        tk.load("http://127.0.0.1:9/part.off")


def test_an_unknown_kind_of_address() -> None:
    with pytest.raises(tk.ReadError, match=r"nowhere://part\.stl could not be read"):
        tk.load("nowhere://part.stl")


def test_without_fsspec_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "fsspec", None)
    with pytest.raises(tk.MissingDependencyError, match=r"topokit\[cluster\]"):
        tk.load("s3://bucket/part.stl")


def test_zarr_is_read_where_it_is(memory: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    zarr = pytest.importorskip("zarr")
    values = np.ones((20, 20, 20), np.uint8)
    values[:, 8:12, 8:12] = 0
    zarr.create_array("memory://topokit/volume.zarr", data=values, chunks=(10, 10, 10))
    zarr.create_group("memory://topokit/group.zarr").create_array("raw", data=values, chunks=(10, 10, 10))
    monkeypatch.setattr(remote, "_copy", None)  # nothing is copied
    for address in ("memory://topokit/volume.zarr", "memory://topokit/group.zarr", "memory://topokit/group.zarr/raw"):
        assert tk.load(address).report().genus == 1
        assert tk.from_voxels(address, block_voxels=1000).report().genus == 1
    assert tk.from_labels("memory://topokit/volume.zarr")[1].report().genus == 1
    assert tk.survey("memory://topokit/volume.zarr").rows[0]["genus"] == 1
    with pytest.raises(tk.ReadError, match=r"memory://topokit/none.zarr"):
        tk.load("memory://topokit/none.zarr")


def test_a_copy_is_not_counted_block_by_block(memory: Any, tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", np.ones((9, 9, 9), bool))
    memory.pipe("/topokit/v.npy", (tmp_path / "v.npy").read_bytes())
    with pytest.raises(tk.InputError, match="only a copy while it is opened"):
        tk.from_voxels("memory://topokit/v.npy", block_voxels=100)
    assert tk.from_voxels("memory://topokit/v.npy").report().euler == 2


def test_surveys_and_the_command_line_take_addresses(mesh: Path, memory: Any) -> None:
    for name in ("a.off", "b.off"):
        memory.pipe(f"/topokit/{name}", mesh.read_bytes())
    survey = tk.survey(["memory://topokit/*.off", "memory://topokit/none.off", str(mesh)])
    a, b, none, local = survey.rows
    assert [row["genus"] for row in survey.rows] == [2, 2, None, 2]
    assert a["file"] == "memory:///topokit/a.off"  # as fsspec writes what a pattern stands for
    assert (none["file"], local["file"]) == ("memory://topokit/none.off", str(mesh))
    assert tk.load(b["file"]).report().genus == 2
    assert "does not exist" in survey.rows[2]["error"]
    found = CliRunner().invoke(app, ["genus", "memory://topokit/a.off"])
    assert (found.exit_code, found.stdout) == (0, "2\tcertain\tmemory://topokit/a.off\n")
    found = CliRunner().invoke(app, ["handles", "memory://topokit/a.off"])
    assert found.exit_code == 0, found.output
