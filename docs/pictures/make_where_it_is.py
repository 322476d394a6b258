"""Make the pictures of docs/where-it-is.md: handles, tunnels, boundaries and defects drawn on shapes of four kinds.

python docs/pictures/make_where_it_is.py
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

import topokit as tk
from topokit.testing import genus_mesh, icosphere, torus_samples
from topokit.testing.meshes import joined

PICTURE = Path(__file__).with_name("where-it-is.webp")
SIDE = 300
Eye = tuple[float, float, float]


def main() -> None:
    """Draw the shapes side by side."""
    panels = [shape.picture(SIDE, eye=eye, locate=True) for shape, eye in shapes()]
    picture = Image.new("RGB", (SIDE * len(panels), SIDE), "white")
    for number, panel in enumerate(panels):
        picture.paste(panel, (SIDE * number, 0))
    picture.save(PICTURE, quality=80)
    print(PICTURE)


def shapes() -> Iterator[tuple[tk.Shape, Eye]]:
    """A mesh with three holes, a cloud, a volume, and a bowl that is pierced by a pin; with directions to the eye."""
    yield tk.from_mesh(genus_mesh(3)), (0.4, -0.9, 1.4)
    yield tk.from_points(torus_samples(20_000).points), (0.5, -1.0, 1.0)
    yield tk.from_voxels(frame(), level=0.0), (0.7, -1.2, 0.9)
    yield tk.from_mesh(pierced_bowl()), (0.5, -1.2, 1.1)


def frame() -> np.ndarray:
    """The edges of a cube, rounded, as a volume."""
    points = np.stack(np.meshgrid(*[np.linspace(-1.3, 1.3, 60)] * 3, indexing="ij"), axis=-1)
    off = np.sort(np.abs(np.abs(points) - 0.9), axis=-1)[..., :2]
    outside = np.maximum(np.abs(points).max(axis=-1) - 0.9, 0)
    return 0.2 - np.maximum(np.hypot(off[..., 0], off[..., 1]), outside)


def pierced_bowl() -> tuple[np.ndarray, np.ndarray]:
    """A sphere without its top, and a thin ellipsoid through its wall."""
    vertices, faces = icosphere(4)
    bowl = vertices, faces[vertices[faces].mean(axis=1)[:, 2] < 0.5]
    pin = vertices * (0.5, 0.12, 0.12) + (0.6, -0.75, 0.0), faces
    return joined(bowl, pin)


if __name__ == "__main__":
    main()
