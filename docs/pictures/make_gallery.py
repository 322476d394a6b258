"""Make docs/gallery.md and its pictures: shapes of every kind, each with the first line of its report.

python docs/pictures/make_gallery.py [CAPTURE]

CAPTURE is the splat scene of the last picture (`CREDIT` says which); it is not part of this repository. Without it
there is no such picture.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

import topokit as tk
from topokit.testing import genus_mesh, linked_tori_mesh, torus_samples

HERE = Path(__file__).parent
SIDE = 360
CREDIT = "The scene is PLAYBOT by Stephane Agullo, from superspl.at (ee6d8bc4), CC BY 4.0; the picture is ours."
HEAD = """\
# Gallery

Written by `python docs/pictures/make_gallery.py`: `shape.picture()` of shapes of every kind, colored by Gaussian
curvature (blue negative, white zero, red positive), each with the first line of its report. All of it runs on the
CPU, without a display.
"""


def main() -> None:
    """Draw every shape and write the page."""
    parts = [HEAD]
    for name, says, shape, eye in shapes(*sys.argv[1:]):
        picture = HERE / f"gallery-{name}.webp"
        shape.picture(SIDE, eye=eye).save(picture, quality=80)
        line = str(shape.replace(name=says).report()).splitlines()[0]
        print(line)
        parts.append(f"![{says}](pictures/{picture.name})\n\n{line}\n")
        if name == "capture":
            parts.append(f"{CREDIT}\n")
    (HERE.parent / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


def shapes(capture: str | None = None) -> Iterator[tuple[str, str, tk.Shape, tuple[float, float, float]]]:
    """Name, what it is, shape and the direction to the eye.

    Args:
        capture: path of a splat scene.
    """
    yield "genus5", "A mesh with five holes", tk.from_mesh(genus_mesh(5, resolution=32)), (0.5, -0.9, 1.3)
    yield "linked", "Two linked tori", tk.from_mesh(linked_tori_mesh(120, 60)), (0.6, -1.2, 0.9)
    sheet = tk.from_sdf(gyroid, resolution=128, field_resolution=128)
    yield "gyroid", "A gyroid sheet in a ball, as a function", sheet, (0.9, -1.3, 0.9)
    cloud = tk.from_points(torus_samples(10_000).points)
    yield "cloud", "A torus as 10 000 points without normals", cloud, (0.5, -1.0, 1.0)
    yield "volume", "A volume: two balls, joined by three bars", tk.from_voxels(dumbbell(), level=0.0), (0.6, -1.4, 0.8)
    splats = tk.from_splats(ring_of_splats(), n_samples=6_000)  # one sample for each splat
    yield "splats", "A ring of 6 000 Gaussian splats", splats, (0.4, -1.0, 1.1)
    if capture is not None:
        yield "capture", "The object in a scene of 31 000 splats", tk.load(capture, object=True), (0.9, -0.5, 1.3)


def ring_of_splats() -> tk.GaussianSplats:
    """Flat splats on a torus."""
    samples = torus_samples(6_000)
    n = samples.normals
    upright = torch.stack((1 + n[:, 2], -n[:, 1], n[:, 0], torch.zeros_like(n[:, 0])), dim=1)
    upright[n[:, 2] < -0.999] = torch.tensor([0.0, 1.0, 0.0, 0.0], dtype=n.dtype)
    flat = torch.tensor([0.03, 0.03, 0.001], dtype=n.dtype).expand_as(n)
    return tk.GaussianSplats(samples.points, flat, upright, torch.ones(len(n), dtype=n.dtype))


def gyroid(p: Tensor) -> Tensor:
    """A thick gyroid sheet, cut off smoothly by a ball."""
    x, y, z = (4.9 * p).unbind(-1)
    sheet = (x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos()).abs() - 0.5
    return torch.logsumexp(torch.stack((30 * sheet / 6, 30 * (p.norm(dim=-1) - 0.9))), 0) / 30


def dumbbell() -> Tensor:
    """Two balls that three bars join: genus 2, positive inside."""
    axis = torch.linspace(-1, 1, 72)
    x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
    balls = [0.33 - torch.sqrt((x - side * 0.5) ** 2 + y**2 + z**2) for side in (-1, 1)]
    bars = [
        torch.minimum(0.07 - torch.hypot(y - 0.22 * np.cos(turn), z - 0.22 * np.sin(turn)), 0.5 - x.abs())
        for turn in (0.5, 2.6, 4.7)
    ]
    return torch.stack([*balls, *bars]).amax(0)


if __name__ == "__main__":
    main()
