"""Triage of Gaussian splats before an hour is spent on meshing: a folder of files in, a table out.

    python examples/splat_triage.py [FOLDER]

Without a folder it writes a few scenes of its own: a closed torus, a bowl that is open at the top, an object among
floaters, a scene of two objects, and a file that was cut off.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import torch
from rich import box
from rich.console import Console
from rich.table import Table
from torch import Tensor

import topokit as tk
from topokit.testing import sphere_samples, torus_samples

SUFFIXES = {".ply", ".splat", ".spz", ".sog", ".ksplat"}


def main() -> None:
    parser = argparse.ArgumentParser(description="Which of these captures are closed, and of what genus?")
    parser.add_argument("folder", nargs="?", type=Path, help="folder of splat files; scenes of its own by default")
    folder = parser.parse_args().folder
    if folder is not None:
        triage(folder)
        return
    with tempfile.TemporaryDirectory() as temporary:
        write_examples(Path(temporary))
        triage(Path(temporary))


def triage(folder: Path) -> None:
    """Print one row per splat file of the folder, then the reasons for each verdict."""
    console = Console()
    table = Table("file", "surface", "components", "genus", "χ", "verdict", box=box.SIMPLE)
    reasons: list[tuple[str, tuple[str, ...]]] = []
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in SUFFIXES and not (path / "meta.json").is_file():
            continue
        try:
            report = tk.from_splats(path).report()
        except tk.TopokitError as error:
            table.add_row(path.name, "unreadable", "", "", "", "")
            reasons.append((path.name, (str(error),)))
            continue
        surface = "closed" if report.closed else "open"
        answers = (report.components, report.genus, report.euler)
        cells = ("?" if answer is None else str(answer) for answer in answers)
        table.add_row(path.name, surface, *cells, report.verdict)
        reasons.append((path.name, report.reasons))
    console.print(table)
    for name, sentences in reasons:
        console.print(name, style="bold", highlight=False)
        for sentence in sentences:
            console.print(f"  - {sentence}", highlight=False, markup=False)


def write_examples(folder: Path) -> None:
    """Five scenes with known answers."""
    torus = torus_samples(6000)
    torus_discs = discs(torus.points, torus.normals, torus.area)
    ball = sphere_samples(6000)
    sphere_discs = discs(ball.points, ball.normals, ball.area)
    torus_discs.to_ply(folder / "1-torus.ply")
    sphere_discs[ball.points[:, 2] < 0.5].to_ply(folder / "2-open-bowl.ply")
    scattered = discs(20 * ball.points[:40] + 30, ball.normals[:40], ball.area / 150)
    joined(torus_discs, scattered).to_ply(folder / "3-torus-and-floaters.ply")
    aside = tk.GaussianSplats(ball.points + 4, sphere_discs.scales, sphere_discs.quaternions, sphere_discs.opacities)
    joined(aside, torus_discs).to_ply(folder / "4-two-objects.ply")
    whole = (folder / "1-torus.ply").read_bytes()
    (folder / "5-cut-off.ply").write_bytes(whole[: len(whole) // 2])


def discs(points: Tensor, normals: Tensor, area: float) -> tk.GaussianSplats:
    """Flat Gaussians on points (N, 3) whose smallest axis is the normal, turned up or down at random."""
    generator = torch.Generator().manual_seed(0)
    n_splats = len(points)
    sign = torch.randint(0, 2, (n_splats, 1), generator=generator) * 2 - 1
    x, y, z = (normals * sign).unbind(-1)
    upwards = torch.stack((1 + z, -y, x, torch.zeros_like(z)), dim=-1)  # the rotation that turns z to the normal
    downwards = torch.stack((-y, 1 - z, torch.zeros_like(z), x), dim=-1)  # the same, through −z
    quaternions = torch.where(z[:, None] > 0, upwards, downwards)
    wide = math.sqrt(area / n_splats) * (0.6 + 0.3 * torch.rand(n_splats, 2, generator=generator, dtype=points.dtype))
    scales = torch.cat((wide, 0.03 * wide[:, :1]), dim=-1)
    opacities = 0.5 + 0.5 * torch.rand(n_splats, generator=generator, dtype=points.dtype)
    return tk.GaussianSplats(points, scales, quaternions, opacities)


def joined(first: tk.GaussianSplats, second: tk.GaussianSplats) -> tk.GaussianSplats:
    """Both scenes in one."""
    parts = ("means", "scales", "quaternions", "opacities")
    return tk.GaussianSplats(*(torch.cat((getattr(first, part), getattr(second, part))) for part in parts))


if __name__ == "__main__":
    main()
