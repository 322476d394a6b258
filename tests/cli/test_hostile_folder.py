"""A folder of 30 hostile files and 30 good ones, all with hostile names, in every form of results."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import sys
import zipfile
from collections.abc import Callable, Iterator
from html import unescape
from pathlib import Path
from urllib.parse import unquote_to_bytes, urlsplit

import pytest
from _pytest.mark import ParameterSet
from rich.cells import cell_len
from typer.testing import CliRunner, Result
from write_test_files import ascii_stl, cube, obj, off, ply, stl

import topokit as tk
from topokit.cli.app import app
from topokit.testing import torus_mesh
from topokit.text import printable

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names")

DATA = Path(__file__).resolve().parents[1] / "data"
FORMS = ("--table", "--json", "--jsonl", "--csv", "--html")
STEMS = (
    b"=cmd|' !A0",
    b"caf\xe9",
    b"\x1b]0;owned\x07\x1b[31m",
    b"two\nlines\r",
    b"<script>alert(1)<script>",
    b"<img src=x onerror=alert(1)>&amp;",
    b'a,"b";=1+1',
    b"+1",
    b"-2+3",
    b"@SUM(1)",
    b"\xff\xfe",
    "c1 \x9b31m \u202eddo\u2028 東.".encode(),
    b"[bold]{tag}[red] %s {0}",
    b"line\tbreak",
    b" '",
)


def zip_bomb() -> bytes:
    """A small archive whose member claims four gigabytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("arr_0.npy", bytes(10_000))
    content = bytearray(buffer.getvalue())
    place = content.index(b"PK\x01\x02") + 24  # of the size in the directory
    content[place : place + 4] = (0xF0000000).to_bytes(4, "little")
    return bytes(content)


HOSTILE: dict[str, bytes] = {
    "empty.stl": b"",
    "short.stl": (DATA / "truncated.stl").read_bytes(),
    "words.obj": b"hello\n" * 9,
    "page.stl": b"<!doctype html><title>not found</title>",
    "wrong.glb": stl(torus_mesh(6, 4)),
    "nan.off": off(cube()).replace(b"0.000000", b"nan"),
    "bomb.npz": zip_bomb(),
    "words.xyz": b"the quick brown fox\n" * 5,
    "code.dae": b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bbbb">]><COLLADA version="1.4.1">&b;</COLLADA>',
    "list.gltf": b"[[[1, 2, 3]]]",
    "noise.splat": bytes(range(251)),
    **{path.name: path.read_bytes() for path in sorted((DATA / "damaged").iterdir())},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("uploads")
    torus = torus_mesh(6, 4)
    writers: tuple[tuple[str, Callable[..., bytes]], ...] = (
        (".stl", stl),
        (".obj", obj),
        (".off", off),
        (".ply", ply),
        (".STL", ascii_stl),
    )
    for number in range(30):
        suffix, write = writers[(number + number // len(STEMS)) % len(writers)]  # each name with two formats
        name = STEMS[number % len(STEMS)] + f"{number}{suffix}".encode()
        Path(os.fsdecode(os.fsencode(folder) + b"/" + name)).write_bytes(write(torus))
    for number, (name, content) in enumerate(HOSTILE.items()):
        path = os.fsdecode(os.fsencode(folder) + b"/" + STEMS[number % len(STEMS)] + name.encode())
        Path(path).write_bytes(content)
    assert len(HOSTILE) == 30
    assert len(os.listdir(folder)) == 60
    return folder


@pytest.fixture(autouse=True)
def here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)  # so that names begin as they are


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


def original(name: str) -> str:
    """The name of the file that a name in data stands for."""
    return os.path.relpath(os.fsdecode(unquote_to_bytes(urlsplit(name).path))) if name.startswith("file:") else name


def check_rows(rows: list[dict[str, object]]) -> None:
    """Every file has a row; those of hostile files say why."""
    assert sorted(original(str(row["file"])) for row in rows) == sorted(os.listdir())
    failed = [row for row in rows if row.get("error")]
    assert len(failed) == 30
    assert all(len(str(row["error"])) > 30 for row in failed)
    assert all(str(row["genus"]) == "1" for row in rows if not row.get("error"))


def check_table(text: str) -> None:
    lines = text.splitlines()
    assert len(lines) == 61
    assert sum(" failed" in line for line in lines) == sum(" certain " in line for line in lines) == 30
    assert len({cell_len(re.split(" (?=verdict|failed|certain)", line)[0]) for line in lines}) == 1


def check_csv(text: str) -> None:
    rows = list(csv.DictReader(io.StringIO(text)))
    check_rows(rows)  # type: ignore[arg-type]
    cells = [cell for row in rows for cell in row.values()]
    assert not [cell for cell in cells if re.match(r"[=+@\t\r]|-\D", cell)]
    assert text.count("\n") == 61


def check_page(text: str) -> None:
    names = re.findall(r'class="name"><a [^>]*>(.*?)</a>', text, re.DOTALL)
    assert sorted(map(unescape, names)) == sorted(map(printable, os.listdir()))
    assert text.count('data-verdict="failed"') == text.count('data-verdict="certain"') == 30
    assert len(re.findall(r'<td class="reason">[^<]{30,}</td>', text)) == 60
    assert "<script>alert" not in text
    assert "<img src=x" not in text


CHECKS: dict[str, Callable[[str], None]] = {
    "--table": check_table,
    "--json": lambda text: check_rows(json.loads(text)),
    "--jsonl": lambda text: check_rows([json.loads(line) for line in text.splitlines()]),
    "--csv": check_csv,
    "--html": check_page,
}


def cases() -> Iterator[ParameterSet]:
    """Pages and processes take longest."""
    for form in FORMS:
        for jobs in (1, 2):
            yield pytest.param(form, jobs, marks=[pytest.mark.long] if form == "--html" or jobs == 2 else [])


@pytest.mark.parametrize(("form", "jobs"), list(cases()))
def test_every_file_has_an_answer_or_says_why(tmp_path: Path, form: str, jobs: int) -> None:
    output = tmp_path / ("page.html" if form == "--html" else "results")
    where = ("--table", "--html", output) if form == "--html" else (form, "-o", output)
    found = invoke("report", ".", *where, "--jobs", jobs)
    assert found.exit_code == 1, found.output
    CHECKS[form](output.read_bytes().decode("utf-8"))
    told = [line for line in found.stderr.splitlines() if line.startswith("topokit: ")]
    assert len(told) == 30
    assert [printable(line) for line in told] == told


def test_rows_are_resumed_and_become_a_table(tmp_path: Path, folder: Path) -> None:
    journal = tmp_path / "rows.jsonl"
    rows = tk.survey(".", resume=journal).rows
    check_rows(rows)
    content = journal.read_bytes()
    content.decode("utf-8")
    assert tk.survey(folder, resume=journal).summary().n_errors == 30
    assert journal.read_bytes() == content
    parquet = pytest.importorskip("pyarrow.parquet")
    survey = tk.survey(".", resume=journal)
    survey.save_parquet(tmp_path / "rows.parquet")
    check_rows(parquet.read_table(tmp_path / "rows.parquet").to_pylist())


@pytest.mark.parametrize("command", ["euler", "report", "handles", "picture", "curvature"])
def test_no_command_writes_what_a_terminal_obeys(tmp_path: Path, command: str) -> None:
    more = {
        "picture": ("-o", tmp_path / "a\x1b[31m.png", "--side", 16),
        "curvature": ("-o", tmp_path / "a\x1b[31m.ply"),
    }
    good = next(name for name in os.listdir() if name.startswith("\x1b") and name.endswith(".ply"))
    for name in (good, "two\nlines\rpage.stl", "\x1b[31mgone\n.stl", "--\x1b[31m"):
        found = invoke(command, name, *more.get(command, ()))
        assert found.exit_code == (0 if name == good else 2 if name.startswith("--") else 1), found.output
        assert "\x1b[31m" not in found.output
        assert "\nlines" not in found.output
        assert not found.output or name == good or printable(name) in found.output
