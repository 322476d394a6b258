"""The forms of results, where they go, and the exit code, in this process."""

from __future__ import annotations

import csv
import io
import json
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import typer
from rich.text import Text
from typer.testing import CliRunner, Result

import topokit as tk
from topokit.batch.examine import COLUMNS
from topokit.cli.app import app
from topokit.cli.options import NAMES, Opener
from topokit.errors import InputError, Option
from topokit.plugins.foreign_code import options_of
from topokit.plugins.registry import list_adapters

DATA = Path(__file__).resolve().parents[1] / "data"


def invoke(*arguments: object, charset: str = "utf-8", stdin: bytes | None = None) -> Result:
    return CliRunner(charset=charset).invoke(app, list(map(str, arguments)), input=stdin)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A torus, a bowl, a broken file and a note."""
    for name in ("torus.stl", "bowl.obj", "truncated.stl"):
        shutil.copy(DATA / name, tmp_path)
    (tmp_path / "notes.md").write_text("# Notes")
    return tmp_path


def test_a_folder_as_text(folder: Path) -> None:
    found = invoke("report", folder)
    assert found.exit_code == 1
    assert re.findall(r"^\S+: Euler.*", found.stdout, re.MULTILINE) == [
        "bowl.obj: Euler characteristic 1 (certain), genus 0, 1 component, not closed",
        "torus.stl: Euler characteristic 0 (certain), genus 1, 1 component, closed",
    ]
    assert found.stderr.splitlines()[0] == "topokit: 1 file of no known format was passed over."
    assert "truncated.stl" in found.stderr.splitlines()[1]
    assert "notes.md" in invoke("report", folder, "--verbose").stderr


def test_a_table_has_a_row_for_every_file(folder: Path) -> None:
    lines = invoke("report", folder, "--table").stdout.splitlines()
    assert lines[0].split() == [
        "file",
        "verdict",
        "euler",
        "genus",
        "components",
        "closed",
        "loops",
        "pieces",
        "tunnels",
        "cavities",
        "seconds",
    ]
    rows = [line.split() for line in lines[1:]]
    assert [Path(row[0]).name for row in rows] == ["bowl.obj", "torus.stl", "truncated.stl"]
    assert rows[0][1:-1] == ["certain", "1", "0", "1", "no", "1", "?", "?", "?"]
    assert rows[1][1:-1] == ["certain", "0", "1", "1", "yes", "0", "1", "1", "0"]
    assert rows[2][1] == "failed"
    assert (
        len({line.index(word) for line, word in zip(lines, ("verdict", "certain", "certain", "failed"), strict=True)})
        == 1
    )


def test_csv_has_every_column(folder: Path) -> None:
    rows = list(csv.DictReader(io.StringIO(invoke("report", folder, "--csv").stdout)))
    assert tuple(rows[0]) == COLUMNS
    assert [row["euler"] for row in rows] == ["1", "0", ""]
    assert "truncated.stl" in rows[2]["error"]


def test_json_lines_and_one_array_hold_the_same(folder: Path) -> None:
    lines = [json.loads(line) for line in invoke("report", folder, "--jsonl").stdout.splitlines()]
    array = json.loads(invoke("report", folder, "--json").stdout)
    assert [list(row) for row in lines] == [list(row) for row in array]
    assert [row.get("surface_betti") for row in lines] == [None, [1, 2, 1], None]
    assert list(lines[2]) == ["file", "error"]
    assert json.loads(invoke("report", "--json", folder / "gone.obj").stdout)[0]["file"].endswith("gone.obj")


def test_results_in_a_file(folder: Path) -> None:
    target = folder / "out.csv"
    found = invoke("report", folder / "torus.stl", "--csv", "-o", target)
    assert (found.exit_code, found.stdout) == (0, "")
    assert target.read_text(encoding="utf-8").startswith("file,label,adapter,verdict")
    content = (folder / "torus.stl").read_bytes()
    assert invoke("report", folder, "-o", folder / "torus.stl").exit_code == 2
    assert (folder / "torus.stl").read_bytes() == content
    assert invoke("report", folder, "-o", folder / "no" / "out.txt").exit_code == 2


def test_a_page_is_written_besides(folder: Path) -> None:
    page = folder / "page.html"
    found = invoke("report", folder, "--table", "--html", page)
    assert found.exit_code == 1
    assert len(found.stdout.splitlines()) == 4
    text = page.read_text(encoding="utf-8")
    assert text.count("data:image/webp") == 2
    assert "truncated.stl" in text
    assert invoke("report", folder, "--html", folder / "page.txt").exit_code == 2


@pytest.mark.parametrize(
    ("condition", "code"),
    [
        ("unsure", 0),
        ("certain", 1),
        ("likely", 0),
        ("open", 1),
        ("genus>0", 1),
        ("genus>1", 0),
        ("genus>1,components>=1", 1),
        ("boundary-loops==1", 1),
        ("cavities>0", 1),  # those of the bowl are unknown
        ("euler<0", 0),
        ("non-manifold", 0),
    ],
)
def test_conditions_set_the_exit_code(folder: Path, condition: str, code: int) -> None:
    files = folder / "torus.stl", folder / "bowl.obj"
    assert invoke("euler", *files, "--fail-on", condition).exit_code == code
    assert invoke("euler", DATA / "edge_sharing_cubes.obj", "--fail-on", "non-manifold").exit_code == 1


def test_who_met_a_condition_is_said(folder: Path) -> None:
    found = invoke("report", folder / "torus.stl", folder / "bowl.obj", "--fail-on", "genus>0,open,cavities>2", "--csv")
    assert found.stderr.splitlines() == [
        f"topokit: {folder / 'torus.stl'} meets genus>0 (1)",
        f"topokit: {folder / 'bowl.obj'} meets open, cavities>2 (unknown)",
    ]


def test_all_files_are_examined_unless_it_shall_stop(folder: Path) -> None:
    files = folder / "truncated.stl", folder / "torus.stl"
    assert invoke("euler", *files).stdout == f"0\tcertain\t{files[1]}\n"
    found = invoke("euler", *files, "--fail-fast")
    assert (found.exit_code, found.stdout) == (1, "")


def test_standard_input(folder: Path) -> None:
    torus, bowl = ((folder / name).read_bytes() for name in ("torus.stl", "bowl.obj"))
    found = invoke("report", "-", "--format", "stl", stdin=torus)
    assert found.stdout.startswith("stdin.stl: Euler characteristic 0 (certain), genus 1"), found.stderr
    found = invoke("genus", folder / "bowl.obj", "-", "--format", "obj", stdin=bowl)
    assert found.stdout.splitlines() == [f"0\tcertain\t{folder / 'bowl.obj'}", "0\tcertain\t-"]
    found = invoke("euler", "-", stdin=(DATA / "sphere.ply").read_bytes())  # known by its content
    assert found.stdout == "2\tcertain\t-\n"
    found = invoke("euler", "-", "--format", "stl", stdin=torus[:500])
    assert (found.exit_code, found.stdout) == (1, "")
    assert found.stderr.startswith("topokit: - ")
    assert invoke("euler", "-", "--format", "../stl", stdin=torus).exit_code == 2
    assert invoke("euler", "-", "-", stdin=torus).exit_code == 2


def test_labels_of_a_volume(tmp_path: Path) -> None:
    volume = np.zeros((9, 9, 9), dtype=np.uint8)
    volume[1:6, 1:6, 1:6], volume[3, 3, 1:6], volume[7, 7, 7] = 4, 9, 9
    np.save(tmp_path / "parts.npy", volume)
    found = invoke("genus", tmp_path / "parts.npy", "--labels", "all")
    parts = tmp_path / "parts.npy"
    assert found.stdout.splitlines() == [f"1\tcertain\t{parts}, label 4", f"0\tcertain\t{parts}, label 9"]
    (row,) = [json.loads(line) for line in invoke("euler", parts, "--labels", "9", "--jsonl").stdout.splitlines()]
    assert row == {"file": str(parts), "label": 9, "euler": 4, "verdict": "certain"}
    assert "no voxel has the label 5" in invoke("euler", parts, "--labels", "5").stderr


def test_a_table_of_labels_shows_whole_names(tmp_path: Path) -> None:
    np.save(tmp_path / "parts.npy", np.arange(4).repeat(16).reshape(8, 2, 4))
    for labels, shown in (("all", (1, 2, 3)), ("2,3", (2, 3))):
        lines = invoke("report", tmp_path / "parts.npy", "--labels", labels, "--table").stdout.splitlines()
        names = [f"{tmp_path / 'parts.npy'}, label {label} " for label in shown]
        assert [line[: len(name)] for line, name in zip(lines[1:], names, strict=True)] == names
        assert len({line.index("certain") for line in lines[1:]} | {lines[0].index("verdict")}) == 1


def test_files_of_one_name_are_told_apart(folder: Path) -> None:
    for name in ("left", "right"):
        (folder / name).mkdir()
        shutil.copy(DATA / "sphere.ply", folder / name / "part.ply")
    found = invoke("report", folder, "--html", folder / "page.html")
    assert re.findall(r"^(\S+): Euler", found.stdout, re.MULTILINE) == [
        "bowl.obj",
        str(Path("left", "part.ply")),
        str(Path("right", "part.ply")),
        "torus.stl",
    ]
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert re.findall(r'class="name"><a [^>]*>([^<]*)<', page) == [
        "truncated.stl",
        "bowl.obj",
        "left/part.ply",
        "right/part.ply",
        "torus.stl",
    ]
    assert str(folder) not in page


def test_advice_is_given_in_options(tmp_path: Path) -> None:
    (tmp_path / "letter.obj").write_text("hello\n" * 9)
    assert "for points use --adapter points." in invoke("euler", tmp_path / "letter.obj").stderr
    found = invoke("euler", DATA / "sphere.ply", "--adapter", "voxels").stderr
    assert "from_" not in found
    found = invoke("report", DATA / "sphere.ply", "--adapter", "points", "--neighbors", 2000).stderr
    assert "--neighbors" in found
    assert "n_neighbors" not in found


def test_options_are_worded_as_they_are_written(tmp_path: Path) -> None:
    np.save(tmp_path / "level=2.npy", np.random.default_rng(0).random((4, 4, 4)))
    found = invoke("report", tmp_path).stderr
    assert "pass --level … (inside" in found
    assert "--label …" in found
    with pytest.raises(InputError, match=r"pass level=… \(inside .* label=…"):
        tk.load(tmp_path / "level=2.npy")
    error = InputError("Pass ", Option("n_samples"), ", or ", Option("adapter", "'points'", "topokit.from_points"), ".")
    assert str(error) == "Pass n_samples, or topokit.from_points."
    assert Opener(None, {}).worded(error) == "Pass --samples, or --adapter points."
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert pickle.loads(pickle.dumps(error)).parts == error.parts


def test_a_file_that_is_called_like_an_option_keeps_its_name(tmp_path: Path) -> None:
    (tmp_path / "level=2.stl").write_text("hello")
    assert "level=2.stl" in invoke("report", tmp_path / "level=2.stl").stderr


@pytest.mark.parametrize("charset", ["ascii", "cp1252", "cp437", "latin-1", "utf-8"])
def test_any_encoding_carries_what_is_said(folder: Path, charset: str) -> None:
    shutil.copy(DATA / "torus.stl", folder / "Größe χ − 東.stl")
    found = invoke("report", folder, charset=charset)
    assert found.exit_code == 1
    assert not isinstance(found.exception, UnicodeError)
    minus = "−" if charset == "utf-8" else "-"
    assert f"V {minus} E + F = 0" in found.stdout
    if charset == "ascii":
        assert "Gr\\xf6\\xdfe chi - \\u6771.stl: Euler" in found.stdout
    for form in ("--json", "--jsonl", "--table", "--csv"):
        text = invoke("report", folder, form, charset=charset).stdout
        assert ("E + F" in text) == (form != "--table")
        if form == "--json":
            assert json.loads(text)[0]["evidence"][0]["name"] == "V − E + F"
            assert Path(json.loads(text)[0]["file"]).name == "Größe χ − 東.stl"
    assert invoke("report", "--help", charset=charset).exit_code == 0
    assert invoke("adapters", charset=charset).exit_code == 0


def test_every_option_of_every_adapter_has_a_name_of_its_own() -> None:
    """The table of options is complete: what can be written in a shell needs no -O."""
    from topokit.cli.values import is_writable

    known = {*NAMES, "activated"}  # the last one is for dictionaries
    for adapter in list_adapters():
        if "topokit" in str(adapter.opener) and (adapter.suffixes or not adapter.types):
            written = {name for name, one in (options_of(adapter) or {}).items() if is_writable(one)}
            assert written <= known, adapter.name


def test_the_options_of_an_adapter_are_listed() -> None:
    lines = [line.split("\t") for line in invoke("adapters", "voxels").stdout.splitlines()]
    rows = {option: (default, expected) for option, default, expected in lines}
    assert rows["--connectivity"] == ("26", "an integer")
    assert rows["--level"] == ("none", "a number or none")
    assert "--component" in [row["option"] for row in json.loads(invoke("adapters", "splats", "--json").stdout)]
    assert invoke("adapters", "nothing").exit_code == 2


def test_help_and_completion_name_everything() -> None:
    text = Text.from_ansi(invoke("report", "--help").stdout).plain
    for option in ("--labels", "--jobs", "--fail-on", "--html", "--csv", "--format", "--threshold", "--min-opacity"):
        assert option in text
    runner = CliRunner(
        env={"_TOPOKIT_COMPLETE": "complete_bash", "COMP_WORDS": "topokit report --adapter ", "COMP_CWORD": "3"}
    )
    assert {"mesh", "voxels", "occupancy"} <= set(runner.invoke(app, [], prog_name="topokit").stdout.split())


def test_a_table_on_a_narrow_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    from topokit.cli.table import Table

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    row = dict.fromkeys(COLUMNS) | {
        "file": "a/very/long/path/to/a/шар.ply",
        "verdict": "likely",
        "euler": 2,
        "closed": True,
    }
    for width in (24, 40, 60, 120):
        monkeypatch.setenv("COLUMNS", str(width))
        for color in ("", "1"):
            monkeypatch.setenv("NO_COLOR", color)
            monkeypatch.setenv("TERM", "xterm")
            stream = Terminal()
            Table(stream, [row["file"]]).write(row)
            assert ("\x1b[36m" in stream.getvalue()) == (color == "")
            lines = Text.from_ansi(stream.getvalue()).plain.splitlines()
            assert len(lines) == 2
            assert max(map(len, lines)) <= width
            assert "шар.ply  likely" in lines[1]
            assert ("…" in lines[1]) == (width < 120)


ROOT = DATA.parents[1]
COMMANDED = [
    str(page.relative_to(ROOT))
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    if "```sh\ntopokit " in page.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("page", COMMANDED)
def test_commands_of_the_documentation_have_these_options(page: str) -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    text = (ROOT / page).read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE))
    lines = re.findall(r"(?:^|\| )topokit ([a-z]+)\b([^#\n]*)", blocks, re.MULTILINE)
    lines += re.findall(r"`topokit ([a-z]+)\b([^`]*)`", text)
    assert lines
    for name, rest in lines:
        known = {flag for parameter in commands[name].params for flag in (*parameter.opts, *parameter.secondary_opts)}
        assert set(re.findall(r"(?<= )--?[a-z][a-z-]*", rest)) <= known, (name, rest)
