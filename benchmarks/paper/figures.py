"""Pictures: curvature of Kitten and Genus6, a Voronoi cell, self-optimization, and a barcode beside χ."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

import topokit as tk
from benchmarks.paper.baselines import alpha_bars, plateaus, spacing
from benchmarks.paper.self_optimization import TARGET, curves
from benchmarks.paper.shapes import Mesh, generated, read, samples
from benchmarks.paper.tables import Options, Table, installed, missing
from topokit.core.linalg import tangent_basis
from topokit.core.local.curvature import at_neighbors, tangent_neighbors
from topokit.testing import genus_mesh, torus_samples

NAME = "paper-tables.webp"


def draw_curvature(axes: Any, name: str, mesh: Mesh, n: int) -> None:
    """Samples without normals, colored by K."""
    axes.imshow(tk.from_points(samples(mesh, n, 0)[0]).picture(500, eye=(0.9, -1.2, 0.6)))
    axes.set_axis_off()
    axes.set_title(name, fontsize=9)


def draw_cell(axes: Any) -> None:
    """The neighbors of one sample in its tangent plane and its Voronoi cell."""
    from scipy.spatial import Voronoi

    known = torus_samples(2_000)
    local = tk.from_points(known.points, known.normals).curvature()
    row = torch.tensor([0])
    offsets = at_neighbors(known.points, local.neighbors, row) - known.points[:1]
    tangent, _ = tangent_neighbors(offsets, tangent_basis(known.normals[:1], offsets[:, -1]))
    plane = np.concatenate((np.zeros((1, 2)), tangent[0].numpy()))
    diagram = Voronoi(plane)
    cell = diagram.vertices[diagram.regions[diagram.point_region[0]]]
    axes.fill(*cell.T, color="#f0a050", alpha=0.6)
    axes.scatter(*plane[1:].T, s=8, color="#3060a0")
    axes.scatter(0, 0, s=16, color="black")
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"Voronoi cell in the tangent plane, A = {float(local.area[0]):.4f}", fontsize=9)


def draw_convergence(axes: Any, options: Options) -> None:
    """χ over the steps of self-optimization."""
    for name, (found, _) in curves(options).items():
        axes.plot(found.history.numpy(), label=name, marker="o" if name == "Polyak" else None, markersize=3)
    axes.axhline(TARGET, color="gray", linewidth=0.5)
    axes.set_xlabel("step", fontsize=8)
    axes.set_ylabel("χ", fontsize=8)
    axes.legend(fontsize=6)
    axes.set_title("self-optimization of a cloud of genus 3", fontsize=9)


def draw_barcode(axes: Any, points: Tensor) -> None:
    """The longest bars of dimension 1 of a cloud's alpha complex, and what topokit says of it."""
    bars = alpha_bars(points)[1][1]
    bars = bars[np.argsort(bars[:, 1] - bars[:, 0])[::-1]][:20]
    axes.hlines(np.arange(len(bars)), bars[:, 0], bars[:, 1], color="#3060a0")
    axes.invert_yaxis()
    axes.set_yticks([])
    axes.set_xlabel("α", fontsize=8)
    euler = f"{float(tk.from_points(points).gauss_bonnet(20)):.2f}".replace("-", "−")
    axes.set_title(f"its 20 longest bars; χ⁽⁰⁾ = {euler}", fontsize=9)


def draw_alpha_euler(axes: Any, points: Tensor, euler: int) -> None:
    """χ of the same alpha complex against α, beside the true χ."""
    found = plateaus(points, alpha_bars(points)[1])
    values, lengths = np.array([value for value, _ in found]), np.array([length for _, length in found])
    ends = spacing(points) * np.exp(lengths.cumsum())
    axes.step(ends, values, where="pre", color="#3060a0")
    axes.axhline(euler, color="gray", linewidth=0.5)
    axes.set_ylim(euler - 8, euler + 12)
    axes.set_xlabel("α", fontsize=8)
    axes.set_title(f"χ of its alpha complex; the surface has {euler}".replace("-", "−"), fontsize=9)


def draw(options: Options, path: Path) -> None:
    """All panels into one file."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    n = 2_000 if options.quick else 10_000
    meshes = {"genus 3": generated(genus_mesh(3))}
    if options.data is not None:
        folder = options.data / "meshes"
        meshes = {"Kitten": read(folder / "paper_Kitten.obj"), "Genus6surface": read(folder / "paper_Genus6.obj")}
    figure = pyplot.figure(figsize=(11, 6.5), dpi=110)
    for number, (name, mesh) in enumerate(meshes.items()):
        draw_curvature(figure.add_subplot(2, 3, number + 1), f"{name}, K without normals", mesh, n)
    draw_cell(figure.add_subplot(2, 3, 3))
    draw_convergence(figure.add_subplot(2, 3, 4), options)
    if installed("gudhi"):
        points = samples(generated(genus_mesh(3)), n, 0)[0]
        draw_barcode(figure.add_subplot(2, 3, 5), points)
        draw_alpha_euler(figure.add_subplot(2, 3, 6), points, int(TARGET))
    figure.tight_layout()
    figure.savefig(path, pil_kwargs={"quality": 85})


def tables(options: Options) -> list[Table]:
    """The picture, and a note of where it is."""
    table = Table("Figures", [])
    if not installed("matplotlib"):
        table.notes.append(missing("matplotlib", "figures"))
        return [table]
    options.pictures.mkdir(parents=True, exist_ok=True)
    draw(options, options.pictures / NAME)
    table.notes.append(f"Written: {NAME}.")
    return [table]
