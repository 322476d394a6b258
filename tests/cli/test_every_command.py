"""Every command on every representation, in one table."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from plyfile import PlyData
from splat_writers import random_scene, write_ply
from typer.testing import CliRunner, Result

import topokit as tk
from topokit.cli.app import app
from topokit.testing import sphere_samples, torus_mesh


class Ball(torch.nn.Module):
    """An occupancy network, or the negative of a distance."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return 0.7 - (x * x).sum(-1).sqrt()


def write_mesh(path: Path) -> None:
    tk.from_mesh(torus_mesh(12, 8)).to_trimesh().export(path)


def write_points(path: Path) -> None:
    np.savetxt(path, sphere_samples(600).points.numpy())


def write_volume(path: Path) -> None:
    x, y, z = np.meshgrid(*[np.linspace(-1, 1, 20)] * 3, indexing="ij")
    np.save(path, 100 * (0.3 - np.hypot(np.hypot(x, y) - 0.6, z)))


def write_network(path: Path) -> None:
    torch.jit.save(torch.jit.script(Ball()), path)


def write_splats(path: Path) -> None:
    write_ply(path, random_scene(300))


SMALL = ("--resolution", "128", "--samples", "500", "--field-resolution", "32")
FILES: dict[str, tuple[str, Callable[[Path], None], tuple[str, ...], tuple[object, ...] | None]] = {
    "mesh": ("torus.obj", write_mesh, ("--samples", "500"), (0, 1, "certain")),
    "points": ("sphere.xyz", write_points, (), (2, 0, "likely")),
    "voxels": ("torus.npy", write_volume, ("--threshold", "0", "--spacing", "0.1"), (0, 1, "certain")),
    "occupancy": ("ball.pt", write_network, ("--adapter", "occupancy", "--level", "0", *SMALL), (2, 0, "certain")),
    "splats": ("scene.ply", write_splats, ("--component", "all", "--samples", "500"), None),
}


@pytest.fixture(scope="module", params=FILES)
def case(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, tuple[str, ...], object]:
    name, write, options, expected = FILES[request.param]
    path = tmp_path_factory.mktemp(request.param) / name
    write(path)
    return path, options, expected


def invoke(*arguments: object, stdin: bytes | None = None) -> Result:
    found = CliRunner().invoke(app, list(map(str, arguments)), input=stdin)
    assert found.exception is None or isinstance(found.exception, SystemExit), found.exception
    return found


@pytest.mark.parametrize("command", ["report", "euler", pytest.param("genus", marks=pytest.mark.long)])
def test_questions(case: tuple[Path, tuple[str, ...], tuple[object, ...] | None], command: str) -> None:
    path, options, expected = case
    found = invoke(command, path, *options, "--json")
    (row,) = json.loads(found.stdout)
    assert row["file"] == str(path)
    if expected is None:  # random discs: whatever is answered is not believed
        assert row.get("verdict", "unsure") == "unsure"
        return
    assert found.exit_code == 0, found.stderr
    for key, value in zip(("euler", "genus", "verdict"), expected, strict=True):
        assert row.get(key, value) == value
    if command != "euler":
        return
    streamed = invoke(command, "-", "--format", path.suffix, *options, "--json", stdin=path.read_bytes())
    (again,) = json.loads(streamed.stdout)
    assert {**again, "file": "", "name": "", "evidence": ""} == {**row, "file": "", "name": "", "evidence": ""}


def test_curvature(case: tuple[Path, tuple[str, ...], object], tmp_path: Path) -> None:
    path, options, _ = case
    found = invoke("curvature", path, *options, "-o", tmp_path / "out.ply")
    assert found.exit_code == 0, found.stderr
    assert np.isfinite(PlyData.read(str(tmp_path / "out.ply"))["vertex"]["gaussian"]).all()


def test_picture(case: tuple[Path, tuple[str, ...], object], tmp_path: Path) -> None:
    path, options, _ = case
    found = invoke("picture", path, *options, "-o", tmp_path / "out.png", "--side", 48)
    assert found.exit_code == 0, found.stderr
    assert np.asarray(Image.open(tmp_path / "out.png")).std() > 5


def test_page(case: tuple[Path, tuple[str, ...], object], tmp_path: Path) -> None:
    path, options, _ = case
    found = invoke("report", path, *options, "--html", tmp_path / "out.html")
    assert found.exit_code == 0, found.stderr
    assert (tmp_path / "out.html").read_text(encoding="utf-8").count("data:image/webp") == 1
