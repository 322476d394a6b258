"""The command line as a user runs it: streams, exit codes, JSON."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from plyfile import PlyData
from splat_writers import random_scene, write_ply
from typer.testing import CliRunner, Result

import topokit as tk
from topokit.cli.app import app
from topokit.testing import genus_mesh, sphere_samples, torus_mesh


def invoke(*arguments: object) -> Result:
    """In this process, which spares importing torch; `test_process.py` has processes."""
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shapes")
    trimesh.Trimesh(*genus_mesh(2, resolution=12), process=False).export(folder / "double.obj")
    vertices, faces = torus_mesh(20, 10)
    trimesh.Trimesh(vertices, faces[1:], process=False).export(folder / "open.off")
    np.savetxt(folder / "cloud.xyz", sphere_samples(1500).points.numpy())
    (folder / "broken.ply").write_bytes(b"ply\nnonsense")
    x, y, z = np.meshgrid(*[np.linspace(-1, 1, 24)] * 3, indexing="ij")
    np.save(folder / "ct.npy", (1000 * np.exp(-3 * (np.hypot(x, y) - 0.6) ** 2 - 3 * z**2)).astype(np.float32))

    class Occupancy(torch.nn.Module):
        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return (10 * (0.7 - x.norm(dim=-1))).sigmoid()

    torch.jit.save(torch.jit.trace(Occupancy(), torch.rand(4, 3)), folder / "occ.pt")
    write_ply(folder / "scene.ply", random_scene(300))
    return folder


def test_report_answers_every_file_it_can(files: Path) -> None:
    found = invoke("report", files / "broken.ply", files / "double.obj", files / "nowhere.obj", files / "cloud.xyz")
    assert found.exit_code == 1
    assert "double.obj: Euler characteristic -2 (certain), genus 2, 1 component, closed" in found.stdout
    assert "cloud.xyz: Euler characteristic 2 (likely, for features wider than 0." in found.stdout
    assert "broken.ply" in found.stderr
    assert "nowhere.obj does not exist" in found.stderr


def test_report_as_json(files: Path) -> None:
    found = invoke("report", "--json", files / "double.obj", files / "broken.ply", "-k", 15, "--samples", 2000)
    assert found.exit_code == 1
    good, bad = json.loads(found.stdout)
    assert (good["euler"], good["genus"], good["verdict"], good["surface_betti"]) == (-2, 2, "certain", [1, 4, 1])
    assert good["evidence"][0]["name"] == "V − E + F"
    assert bad["file"].endswith("broken.ply")
    assert "broken.ply has no complete .ply header" in bad["error"]


def test_euler_and_genus_print_lines_for_machines(files: Path) -> None:
    found = invoke("euler", files / "double.obj", files / "open.off")
    assert found.exit_code == 0
    assert found.stdout.splitlines() == [f"-2\tcertain\t{files / 'double.obj'}", f"-1\tcertain\t{files / 'open.off'}"]
    assert found.stderr == ""
    found = invoke("genus", files / "cloud.xyz", files / "broken.ply", files / "double.obj")
    assert found.exit_code == 1
    assert found.stdout.splitlines() == [f"0\tlikely\t{files / 'cloud.xyz'}", f"2\tcertain\t{files / 'double.obj'}"]


def test_curvature_writes_a_colored_mesh(files: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.ply"
    found = invoke("curvature", files / "double.obj", "-o", output, "--color-by", "mean")
    assert found.exit_code == 0
    written, mesh = PlyData.read(str(output)), trimesh.load(files / "double.obj", process=False)
    assert len(written["vertex"].data) == len(mesh.vertices)
    assert len(written["face"].data) == len(mesh.faces)
    names = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"}
    assert names | {"gaussian", "mean", "total", "k_min", "k_max", "area"} == set(written["vertex"].data.dtype.names)
    reread = trimesh.load(output, process=False)
    assert reread.euler_number == -2
    mean = written["vertex"]["mean"]
    assert np.median(mean) > 0
    blue = written["vertex"]["blue"].astype(int) - written["vertex"]["red"]
    assert (blue[mean < -0.5] > 0).all()
    assert (blue[mean > 0.5] < 0).all()


def test_curvature_of_a_cloud_keeps_its_points(files: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.ply"
    assert invoke("curvature", files / "cloud.xyz", "-o", output).exit_code == 0
    written = PlyData.read(str(output))
    assert len(written["vertex"].data) == 1500
    assert abs(np.median(written["vertex"]["gaussian"]) - 1) < 0.2


def test_a_folder_that_is_not_there_is_explained(files: Path, tmp_path: Path) -> None:
    found = invoke("curvature", files / "cloud.xyz", "-o", tmp_path / "no" / "out.ply")
    assert found.exit_code == 1
    assert "does not exist: create it first" in found.stderr


def test_curvature_does_not_write_over_what_it_reads_nor_ply_under_another_name(files: Path, tmp_path: Path) -> None:
    cloud = tmp_path / "own.ply"
    assert invoke("curvature", files / "cloud.xyz", "-o", cloud).exit_code == 0
    content = cloud.read_bytes()
    found = invoke("curvature", cloud, "-o", cloud)
    assert (found.exit_code, cloud.read_bytes()) == (1, content)
    assert "is the file to read; name another one to write" in found.stderr
    found = invoke("curvature", cloud, "-o", tmp_path / "out.obj")
    assert found.exit_code == 1
    assert "does not end with .ply" in found.stderr


@pytest.mark.parametrize(
    "arguments", [("report",), ("report", "--no-such-option", "x"), ("fly",), ("report", "-k", "2", "x")]
)
def test_usage_errors_exit_with_2(arguments: tuple[str, ...]) -> None:
    assert invoke(*arguments).exit_code == 2


def test_seed_and_k_reach_the_core(files: Path) -> None:
    answers = [
        json.loads(invoke("report", "--json", "--details", files / "double.obj", *options).stdout)[0]["estimate"]
        for options in (
            ("--samples", 600, *more)
            for more in ((), (), ("--seed", 0), ("--seed", 0), ("--seed", 1), ("-k", 12), ("--samples", 700))
        )
    ]
    assert answers[0] == answers[1]
    assert answers[2] == answers[3]
    assert answers[5] == answers[0], "reports do not depend on the number of neighbors"
    assert len(set(answers)) == 4
    for k in (12, 30):
        found = invoke("curvature", files / "double.obj", "--samples", 600, "-k", k, "-o", files / f"{k}.ply")
        assert found.exit_code == 0, found.stderr
    assert (files / "12.ply").read_bytes() != (files / "30.ply").read_bytes()


# options of adapters


def test_a_gray_volume_needs_a_level_and_gets_one(files: Path) -> None:
    refused = invoke("report", files / "ct.npy")
    assert refused.exit_code == 1
    assert "pass --level … (inside is above it" in refused.stderr
    assert "label --label" not in refused.stderr
    found = invoke("report", files / "ct.npy", "--level", 700)
    assert found.stdout.startswith(
        "ct.npy: 1 piece, 1 tunnel, 0 cavities (χ of the solid 0, of its surface 0), certain"
    )
    for options in (("-O", "level=700"), ("--level=700", "--connectivity", 6, "--spacing", "1,1,2.5")):
        assert invoke("genus", files / "ct.npy", *options).stdout == f"1\tcertain\t{files / 'ct.npy'}\n"


def test_an_occupancy_network_is_opened_by_the_adapter_that_is_named(files: Path) -> None:
    options = ("--adapter", "occupancy", "--resolution", 128, "--bounds", "-1,1", "--batch-size", 5000)
    found = invoke("report", files / "occ.pt", *options)
    answer = found.stdout.splitlines()[0]
    assert answer.startswith("occ.pt: Euler characteristic 2 (certain)"), found.stderr
    by_grids = invoke("report", files / "occ.pt", *options, "--no-certify")
    assert by_grids.stdout.startswith("occ.pt: Euler characteristic 2 (likely, for features wider than 0.")
    assert "genus 0" in answer
    assert invoke("report", files / "occ.pt", "--bounds", "-1,-1,-1,1,1,1").exit_code == 1


def test_an_option_that_an_adapter_lacks_is_an_error_of_that_file_alone(files: Path) -> None:
    cloud, volume = files / "cloud.xyz", files / "ct.npy"
    found = invoke("euler", cloud, volume, "--level", 700)
    assert found.exit_code == 1
    assert found.stdout == f"0\tcertain\t{volume}\n"
    options = "--block-points, --neighbors, --regularize"
    assert found.stderr == f"topokit: {cloud}: adapter 'points' has no option --level. It has: {options}.\n"
    assert invoke("euler", files / "double.obj", cloud, "--samples", 500, "--seed", 3).exit_code == 0


def said(found: Result) -> str:
    """What a usage error says, without the box and the line breaks around it."""
    return " ".join(found.stderr.replace("│", " ").split())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--level", "bone"), "--level is 'bone'; expected a number or none."),
        (("--bounds", "0,0,0,1,1"), "--bounds is '0,0,0,1,1'; expected 6 values with commas between them or 2 values"),
        (("--adapter", "mesh", "--level", "3"), "adapter 'mesh' has no option --level."),
        (("--adapter", "occupancy", "-O", "depth=3"), "adapter 'occupancy' has no option -O depth=…."),
        (("--adapter", "occupation"), "--adapter is 'occupation'; expected mesh or points or voxels"),
        (("--labels", "bone"), "--labels is 'bone'; expected all, or integers with commas between them."),
        (("--fail-on", "ugly"), "--fail-on: 'ugly' is no condition; expected certain, likely, unsure, open,"),
        (("--format", "stl"), "--format is that of standard input: give - as FILE, once."),
        (("--json", "--jsonl"), "--json and --jsonl exclude each other."),
        (("--jobs", "-1"), "should be greater than or equal to 0"),
    ],
)
def test_values_that_cannot_be_used_are_usage_errors(files: Path, options: tuple[str, ...], message: str) -> None:
    found = invoke("euler", files / "ct.npy", *options)
    assert (found.exit_code, found.stdout) == (2, "")
    assert message in said(found)


def test_a_value_that_fits_another_adapter_is_an_error_of_that_file(files: Path) -> None:
    found = invoke("euler", files / "ct.npy", files / "double.obj", "--connectivity", "x26")
    assert found.exit_code == 2
    found = invoke("euler", files / "ct.npy", "--level", "none")
    assert found.exit_code == 1
    assert "pass --level …" in found.stderr


@pytest.mark.parametrize("option", ["level", "generator=1", "n_samples=9"])
def test_options_that_are_written_wrongly_are_usage_errors(files: Path, option: str) -> None:
    assert invoke("euler", files / "ct.npy", "-O", option).exit_code == 2
    assert invoke("euler", files / "ct.npy", "--level", 700, "-O", "level=600").exit_code == 2


def test_advice_can_be_followed_in_the_shell(files: Path, tmp_path: Path) -> None:
    unknown = tmp_path / "level=3" / "thing.abc"
    unknown.parent.mkdir()
    unknown.write_text("words")
    found = invoke("report", unknown)
    assert found.stderr.startswith(f"topokit: {unknown}: '.abc' is not a known format")
    assert "pass --adapter …, one of 'mesh', 'points'" in found.stderr
    found = invoke("report", files / "double.obj", "--samples", 15)
    assert "--samples is 15; it must be larger than --neighbors, which is 20" in found.stderr


def test_splats_are_sampled_as_in_python(files: Path) -> None:
    row = json.loads(invoke("report", "--json", files / "scene.ply").stdout)[0]
    n_samples = tk.load(files / "scene.ply").samples.n_points
    assert any(reason.startswith(f"{n_samples} samples lie on the discs") for reason in row["reasons"])


def test_euler_and_genus_as_json(files: Path) -> None:
    double, broken = files / "double.obj", files / "broken.ply"
    found = invoke("euler", "--json", double, broken)
    assert found.exit_code == 1
    good, bad = json.loads(found.stdout)
    assert good == {"file": str(double), "euler": -2, "verdict": "certain"}
    assert (bad["file"], list(bad)) == (str(broken), ["file", "error"])
    found = invoke("genus", "--json", double)
    assert json.loads(found.stdout) == [{"file": str(double), "genus": 2, "verdict": "certain"}]


def test_the_version() -> None:
    assert invoke("--version").stdout == f"topokit {tk.__version__}\n"


def test_adapters_lists_what_can_be_opened() -> None:
    found = invoke("adapters")
    assert found.exit_code == 0
    rows = [line.split("\t") for line in found.stdout.splitlines()]
    assert [row[0] for row in rows[:2]] == ["mesh", "points"]
    assert rows[0][1].split()[0] == ".obj"
    assert all(len(row) == 3 for row in rows)
    first = json.loads(invoke("adapters", "--json").stdout)[0]
    assert (first["name"], first["usable"], first["problem"]) == ("mesh", True, None)


def test_a_broken_plug_in_is_one_line_on_stderr(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[topokit.adapters]\nbroken = nowhere_to_be_found:Broken\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    tk.refresh_adapters()
    found, adapters = invoke("euler", files / "double.obj", files / "double.obj"), invoke("adapters")
    monkeypatch.undo()
    tk.refresh_adapters()
    assert found.stdout == f"-2\tcertain\t{files / 'double.obj'}\n" * 2
    assert found.stderr.splitlines() == [
        "topokit: adapter 'broken' (nowhere_to_be_found:Broken) is left out: nowhere_to_be_found:Broken could not be "
        "imported (ModuleNotFoundError: No module named 'nowhere_to_be_found')."
    ]
    assert "broken\t-\tbroken: nowhere_to_be_found:Broken could not be" in adapters.stdout


def test_demo_shows_a_mesh_and_a_cloud() -> None:
    found = invoke("demo")
    assert found.exit_code == 0
    assert "a genus-3 mesh: Euler characteristic -4 (certain), genus 3" in found.stdout
    assert "a torus as an unoriented point cloud: Euler characteristic 0" in found.stdout
