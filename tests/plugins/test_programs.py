"""Networks are programs: none is opened but by its own path, bytes or file object, and with its adapter named."""

from __future__ import annotations

import io
import json
import re
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import torch
from intact_files import export_members
from splat_writers import zip_members
from typer.testing import CliRunner

import topokit as tk
from topokit.batch.sources import find_sources
from topokit.cli.app import app
from topokit.errors import InputError
from topokit.plugins.registry import adapter_for

ASKED = r"program.*pass adapter='sdf' or adapter='occupancy'"
ONE_BY_ONE = "named one by one"


class WritesFile(torch.nn.Module):
    """A ball; whoever calls it finds a new file at `place`."""

    def __init__(self, place: str) -> None:
        super().__init__()
        self.place = place

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x.norm(2, 1) - 0.5 + torch.from_file(self.place, True, 4).sum()


@pytest.fixture(scope="module")
def script() -> bytes:
    """A network in TorchScript that writes the file "harm" in the folder where it runs."""
    target = io.BytesIO()
    torch.jit.save(torch.jit.script(WritesFile("harm")), target)
    return target.getvalue()


@pytest.fixture(scope="module")
def exported() -> bytes:
    """An archive of torch.export that makes the folder "harm" while it is opened, by the expression of a symbol."""
    members = export_members()
    model = next(name for name in members if name.endswith("models/model.json"))
    runs = json.dumps("__import__('os').makedirs('harm', exist_ok=True)")
    changed = re.sub(rb'("expr_str": ?)"[^"]*"', lambda found: found.group(1) + runs.encode(), members[model])
    assert changed != members[model]
    return zip_members({**members, model: changed})


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, where a network that runs leaves "harm"."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def is_unharmed(folder: Path) -> bool:
    return not (folder / "harm").exists()


@pytest.mark.parametrize(
    "name", ["bracket.stl", "scan.ply", "README.md", "net.pt", "gear.obj.stl", "x.npz", "no_suffix"]
)
@pytest.mark.parametrize("kind", ["script", "exported"])
def test_no_name_makes_a_file_a_program(kind: str, name: str, here: Path, request: pytest.FixtureRequest) -> None:
    content = request.getfixturevalue(kind)
    (here / name).write_bytes(content)
    with (here / name).open("rb") as file:
        for source in (here / name, str(here / name), content, file):
            with pytest.raises(InputError, match=ASKED):
                tk.load(source)
    assert is_unharmed(here)


def test_what_is_refused_would_run(script: bytes, exported: bytes, here: Path) -> None:
    """The two archives do harm once they are asked for: the other tests are not about files that are damaged."""
    for content in (script, exported):
        (here / "net.pt").write_bytes(content)
        with suppress(tk.TopokitError):
            tk.load(here / "net.pt", adapter="sdf", resolution=128).report()
        assert not is_unharmed(here)
        shutil.rmtree(here / "harm") if (here / "harm").is_dir() else (here / "harm").unlink()


@pytest.mark.parametrize("suffix", [".pt", ".pth", ".pt2", ".ts", ".PT", ".pt.gz"])
def test_suffixes_of_networks_are_refused_whatever_the_content(suffix: str, here: Path) -> None:
    (here / f"net{suffix}").write_bytes(b"\x80\x02c__builtin__\nexit\n.")
    with pytest.raises(InputError, match=ASKED):
        tk.load(here / f"net{suffix}")


def test_bytes_and_files_are_opened_on_request(here: Path) -> None:
    target = io.BytesIO()
    torch.jit.save(torch.jit.trace(torch.nn.Linear(3, 1).eval(), torch.rand(4, 3)), target)
    (here / "net.stl").write_bytes(target.getvalue())
    for source in (here / "net.stl", target.getvalue(), io.BytesIO(target.getvalue())):
        assert isinstance(tk.load(source, adapter="sdf"), tk.Shape)


def test_folders_and_patterns_open_no_program_even_if_its_adapter_is_named(
    script: bytes, exported: bytes, here: Path
) -> None:
    (here / "uploads").mkdir()
    shutil.copy(Path(__file__).parents[1] / "data" / "sphere.ply", here / "uploads" / "a.ply")
    (here / "uploads" / "b.stl").write_bytes(script)
    (here / "uploads" / "c.pt2").write_bytes(exported)
    rows = tk.survey(here / "uploads").rows
    assert [row["euler"] for row in rows] == [2, None, None]
    assert all("program" in row["error"] for row in rows[1:])
    for place in (here / "uploads", f"{here}/uploads/*.pt2", f"{here}/**/[bc]*"):
        for adapter in ("sdf", "occupancy"):
            errors = [row["error"] for row in tk.survey(place, adapter=adapter).rows]
            assert errors
            assert all(ONE_BY_ONE in error for error in errors)
    named = find_sources([here / "uploads" / "c.pt2"], "sdf").sources
    assert [source.problem for source in named] == [None]
    assert is_unharmed(here)


def test_the_command_line_says_how_to_ask(script: bytes, here: Path) -> None:
    (here / "uploads").mkdir()
    (here / "uploads" / "scan.ply").write_bytes(script)
    for files in (("uploads/scan.ply",), ("uploads",), ("uploads/*.ply",)):
        found = CliRunner().invoke(app, ["report", *files, "--jsonl"])
        assert found.exit_code == 1
        assert "pass --adapter sdf or --adapter occupancy" in found.stderr
    for command in (["report", "uploads"], ["euler", "uploads/s*"], ["curvature", "uploads", "-o", "c.ply"]):
        found = CliRunner().invoke(app, [*command, "--adapter", "sdf"])
        assert found.exit_code == 1
        assert ONE_BY_ONE in found.stderr
    assert is_unharmed(here)


@pytest.mark.parametrize("adapter", ["sdf", "occupancy"])
def test_nothing_at_an_address_is_run(adapter: str, script: bytes, here: Path) -> None:
    pytest.importorskip("fsspec")
    (here / "parts.zip").write_bytes(zip_members({"net.pt": script}))
    (here / "net.pt").write_bytes(script)
    for address in (f"file://{here}/net.pt", f"zip://net.pt::file://{here}/parts.zip", f"file://{here}/a.zarr/net.pt"):
        opener: Any = tk.from_sdf if adapter == "sdf" else tk.from_occupancy
        for ask in (lambda: tk.load(address, adapter=adapter), lambda: opener(address)):  # noqa: B023
            with pytest.raises(InputError, match=ONE_BY_ONE):
                ask()
        (row,) = tk.survey(address, adapter=adapter).rows
        assert ONE_BY_ONE in row["error"]
    with pytest.raises(InputError, match=ASKED):
        tk.load(f"file://{here}/net.pt")
    assert is_unharmed(here)


def test_an_archive_that_is_something_harmless_too_is_opened_as_that(here: Path) -> None:
    import numpy as np

    np.savez(here / "cloud.npz", **{"points": np.random.default_rng(0).random((50, 3)), "data.pkl": np.zeros(1)})
    assert adapter_for(here / "cloud.npz").name == "points"


def test_a_plug_in_that_runs_code_is_never_chosen(here: Path) -> None:
    (here / "a.blob").write_bytes(b"blob")
    attributes = {"suffixes": (".blob",), "description": "blobs", "runs_code": "Blobs are rare."}
    tk.register_adapter("blobs", lambda path: tk.from_points(torch.rand(50, 3)), overwrite=True, **attributes)
    try:
        with pytest.raises(InputError, match=r"pass adapter='blobs'.*Blobs are rare"):
            tk.load(here / "a.blob")
        assert tk.load(here / "a.blob", adapter="blobs").samples.n_points == 50
        assert ONE_BY_ONE in str(find_sources(here, "blobs").sources[0].problem)
    finally:
        from topokit.plugins import registry

        registry._registered.pop("blobs")
