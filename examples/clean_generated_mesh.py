"""Clean a generated mesh: remove the tiny handles that are noise, and keep the one that is meant.

    python examples/clean_generated_mesh.py [PICTURE]

The mesh is what generators of shapes give: the level set of a field, here a torus with noise. Its report counts twelve
handles; their sizes say that eleven of them are noise. `simplify` cuts or fills these, and counts the result.
Needs Pillow for the picture. Takes about 15 seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from scipy.ndimage import gaussian_filter

import topokit as tk

CELLS, NOISE = 80, 0.05
EYE = (0.5, -0.9, 1.6)


def generated() -> trimesh.Trimesh:
    """The largest surface of a noisy field whose solid was meant to be a torus."""
    x, y, z = np.meshgrid(*[np.linspace(-1, 1, CELLS)] * 3, indexing="ij")
    noise = gaussian_filter(np.random.default_rng(0).normal(size=x.shape), 1.6)
    field = 0.22 - np.hypot(np.hypot(x, y) - 0.6, z) + NOISE * noise / noise.std()
    surface = tk.from_voxels(field, level=0.0, spacing=2 / (CELLS - 1), origin=(-1, -1, -1)).surface()
    return max(surface.split(only_watertight=True), key=lambda part: part.area)


def main() -> None:
    parser = argparse.ArgumentParser(description="Remove topological noise from a generated mesh.")
    parser.add_argument("picture", nargs="?", type=Path, default=Path("clean_generated_mesh.png"))
    picture = parser.parse_args().picture

    before = tk.from_mesh(generated()).replace(name="before")
    print(before.report())
    sizes = [min(handle.handle_length, handle.tunnel_length) for handle in before.handles()]
    print("sizes of the handles:", ", ".join(f"{size:.2g}" for size in sizes))

    after = before.simplify(below=0.15).replace(name="after")
    print(after.report(locate=True))

    pictures = [shape.picture(400, eye=EYE, locate=True) for shape in (before, after)]
    pair = Image.new("RGB", (800, 400), "white")
    for number, image in enumerate(pictures):
        pair.paste(image, (400 * number, 0))
    pair.save(picture)
    print(picture)


if __name__ == "__main__":
    main()
