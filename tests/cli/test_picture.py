"""`topokit picture` draws a file, with the options of its format, or says what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from topokit.cli.app import app

DATA = Path(__file__).resolve().parents[1] / "data"


def run(*words: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.output


@pytest.mark.parametrize("suffix", [".png", ".webp", ".jpg"])
def test_a_mesh_is_drawn(suffix: str, tmp_path: Path) -> None:
    target = tmp_path / f"torus{suffix}"
    code, output = run("picture", DATA / "torus.stl", "-o", target, "--side", 64)
    assert code == 0, output
    picture = np.asarray(Image.open(target))
    assert picture.shape == (64, 64, 3)
    assert 0.2 < (picture < 240).any(axis=2).mean() < 0.8


def test_a_volume_is_drawn_at_its_level(tmp_path: Path) -> None:
    axis = np.linspace(-1, 1, 20)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    np.save(tmp_path / "ball.npy", np.sqrt(x * x + y * y + z * z))
    pictures = []
    for level in (0.3, 1.6):  # a cube with a ball cut out of it, and the corners of the cube
        code, output = run("picture", tmp_path / "ball.npy", "--level", level, "-o", tmp_path / "a.png", "--side", 40)
        assert code == 0, output
        pictures.append(np.asarray(Image.open(tmp_path / "a.png")))
    cube, corners = ((picture < 240).any(axis=2).mean() for picture in pictures)
    assert corners < 0.7 * cube


@pytest.mark.parametrize(
    ("output", "message"), [("torus.gif", "a picture must be called"), ("no/torus.png", "does not exist")]
)
def test_a_name_that_cannot_be_written_is_refused(output: str, message: str, tmp_path: Path) -> None:
    code, text = run("picture", DATA / "torus.stl", "-o", tmp_path / output)
    assert code == 2
    assert message in " ".join(text.replace("│", " ").split())
    assert not list(tmp_path.iterdir())
