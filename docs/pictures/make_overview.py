"""Make overview.png, the picture of the README: shapes of four kinds, each above the first line of its report.

python docs/pictures/make_overview.py [overview.png]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import zoom
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes
from torch import Tensor

import topokit as tk
from topokit.core.arrays import Floats
from topokit.export.surfels import Surfels, disc_surfels, mesh_surfels, render, unit
from topokit.testing import genus_mesh

SIDE, TEXT = 240, 84  # pixels of a panel and of the text below it
ORANGE, GREEN, PALE, BLUE, RED = np.array(
    [[0.95, 0.66, 0.36], [0.50, 0.76, 0.66], [0.86, 0.90, 0.95], [0.20, 0.45, 0.75], [0.45, 0.20, 0.16]]
)
DARK, GRAY = "#21334f", "#66758a"
Panel = tuple[NDArray[np.uint8], tk.Shape]


def main() -> None:
    """Make all panels and write them side by side."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("overview.png")
    panels = [mesh_panel(), cloud_panel(), function_panel(), *loss_panels()]
    picture = Image.new("RGB", (SIDE * len(panels), SIDE + TEXT), "white")
    draw = ImageDraw.Draw(picture)
    for number, (image, shape) in enumerate(panels):
        picture.paste(Image.fromarray(image), (SIDE * number, 0))
        caption(draw, SIDE * number + SIDE // 2, str(shape.report()).splitlines()[0])
    arrow(draw, SIDE * (len(panels) - 1), SIDE // 2)
    picture.save(path, optimize=True)
    print(f"{path}: {path.stat().st_size // 1000} kB")


def caption(draw: ImageDraw.ImageDraw, middle: int, line: str) -> None:
    """The first line of a report, broken into name, answer and details."""
    print(line)
    name, _, answer = line.partition(": ")
    answer, _, details = answer.partition(" (" if " (χ" in answer else ", ")
    details = details.rpartition("), ")[2]  # the font has no χ
    for text, size, ink, y in ((name, 16, DARK, 0), (answer, 14, DARK, 24), (details, 13, GRAY, 44)):
        draw.text((middle, SIDE + 8 + y), text, fill=ink, font=ImageFont.load_default(size), anchor="ma")


def mesh_panel() -> Panel:
    """A mesh of genus 3, colored by Gaussian curvature."""
    vertices, faces = genus_mesh(3, resolution=48)
    shape = tk.from_mesh((vertices, faces), n_samples=40_000, n_neighbors=60)
    normals = np.zeros_like(vertices)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    for corner in faces.T:
        np.add.at(normals, corner, np.cross(b - a, c - a))
    near = cKDTree(shape.samples.points.numpy()).query(vertices, 24)[1]
    curvature = shape.curvature().gaussian.numpy()[near].mean(1)
    share = np.clip(curvature / np.quantile(np.abs(curvature), 0.6), -1, 1)[:, None]
    ends = np.where(share < 0, (0.16, 0.42, 0.74), (0.84, 0.25, 0.22))
    colors = 0.97 + np.abs(share) * (ends - 0.97)
    surfels = mesh_surfels(vertices, faces, unit(normals), colors)
    return render(surfels, (0.7, -1.0, 1.3), SIDE), shape.replace(name="mesh, Gaussian curvature")


def cloud_panel() -> Panel:
    """A trefoil knot as points without normals, with the normals that were found."""
    t = np.linspace(0, 2 * np.pi, 1500)
    ring = 2 + 0.8 * np.cos(3 * t)
    curve = cKDTree(np.stack((ring * np.cos(2 * t), ring * np.sin(2 * t), 0.8 * np.sin(3 * t)), axis=1))

    def tube(p: Tensor) -> Tensor:
        return torch.from_numpy(curve.query(p.detach().numpy())[0]).to(p) - 0.33

    samples = tk.from_sdf(tube, bounds=((-3.4, -3.4, -3.4), (3.4, 3.4, 3.4))).samples
    shape = tk.from_points(samples.points.detach())
    points, normals = shape.samples.points.numpy(), shape.oriented().samples.normals.numpy()
    body = disc_surfels(points - 0.03 * normals, normals, np.broadcast_to(PALE, points.shape), radius=0.12)
    some, few = slice(None, None, 5), slice(None, None, 25)
    dots = disc_surfels(points[some], normals[some], np.broadcast_to(BLUE, points[some].shape), radius=0.035)
    strokes = (points[few] + np.linspace(0, 0.34, 80)[:, None, None] * normals[few]).reshape(-1, 3)
    eye = (0.3, -0.8, 1.3)
    toward, red = (np.broadcast_to(row, strokes.shape) for row in (unit(np.array(eye)), RED))
    return render(body + dots + Surfels(strokes, toward, red), eye, SIDE), shape.replace(name="points without normals")


def function_panel() -> Panel:
    """A gyroid sheet in a ball, as a function."""

    def gyroid(p: Tensor) -> Tensor:
        x, y, z = (4.9 * p).unbind(-1)
        sheet = (x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos()).abs() - 0.5
        return torch.logsumexp(torch.stack((30 * sheet / 6, 30 * (p.norm(dim=-1) - 0.9))), 0) / 30

    shape = tk.from_sdf(gyroid, resolution=256, field_resolution=128)
    assert shape.field is not None
    surfels = solid_surfels(shape.field.detached().numpy(), GREEN)
    return render(surfels, (0.9, -1.3, 0.9), SIDE), shape.replace(name="function or network")


def loss_panels() -> tuple[Panel, Panel]:
    """A volume before and after a training with the topology loss."""
    axis = torch.linspace(-1, 1, 48)
    x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
    torus = 0.27 - torch.hypot(torch.hypot(x, y) - 0.52, z)
    field, loss = torus.clone().requires_grad_(), tk.TopologyLoss(genus=0)
    optimizer = torch.optim.Adam([field], lr=5e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 100)
    for _ in range(100):
        optimizer.zero_grad()
        ((field - torus).square().mean() + loss(field, keys="torus")).backward()
        optimizer.step()
        schedule.step()
    return volume_panel("volume", torus), volume_panel("TopologyLoss(genus=0)", field.detach())


def volume_panel(name: str, field: Tensor) -> Panel:
    """The solid {field > 0} of a volume."""
    image = render(solid_surfels(zoom(field.numpy(), 2, order=3), ORANGE), (0.4, -0.9, 1.2), SIDE)
    return image, tk.from_voxels(field, level=0.0).replace(name=name)


def solid_surfels(field: Floats, color: Floats) -> Surfels:
    """Surfels on the surface of {field > 0}."""
    vertices, faces, normals, _ = marching_cubes(np.pad(field, 1, constant_values=-1.0), 0.0)
    return mesh_surfels(vertices, faces, -normals, np.broadcast_to(color, vertices.shape))


def arrow(draw: ImageDraw.ImageDraw, middle: int, height: int) -> None:
    """From one panel to the next."""
    draw.line((middle - 11, height, middle + 11, height), fill=DARK, width=2)
    draw.line((middle + 4, height - 6, middle + 11, height, middle + 4, height + 6), fill=DARK, width=2)


if __name__ == "__main__":
    main()
