"""The shapes of the paper's Table II: the files, networks of the same shapes, and stand-ins of the same χ."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import trimesh
from skimage.measure import marching_cubes
from torch import Tensor

import topokit as tk
from topokit.testing import deltoidal_icositetrahedron, edge_tubes, icosphere, torus_knot, triakis_tetrahedron

Mesh = trimesh.Trimesh
_GRID = 128  # cells along a side of the box in which networks become meshes
CLASSES = {
    "A": "the file itself",
    "A′": "made anew, exactly",
    "B": "a network of the same shape",
    "C": "a stand-in",
    "D": "not to be had",
    "T": "from Thingi10K",
}


@dataclass(frozen=True)
class Row:
    """One row of Table II.

    Attributes:
        name: as in the paper.
        kind: a key of `CLASSES`.
        euler: χ of what is measured here.
        make: the mesh to sample, or None.
        text: what is measured, if it is not the paper's shape.
    """

    name: str
    kind: str
    euler: int
    make: Callable[[], Mesh] | None
    text: str = ""


# Numbers of Thingi10K; ChicagoLion was uploaded twice.
THINGI10K = {
    "Quirrel": (37384, 2),
    "HolesSculpture": (44395, -402),
    "Hilb64Thick": (53754, 0),
    "RindStrips": (53159, -12),
    "ChicagoLion": (77319, -4),
    "TriakisTetrahedron": (509308, -20),
    "Icositetrahedron": (509314, -44),
}
NETWORKS = {"Quirrel": 2, "Hilb64Thick": 0, "ChicagoLion": -4, "Icositetrahedron": -44}
NETWORK_FILES = {"Quirrel": 37384, "Hilb64Thick": 53754, "ChicagoLion": 92880, "Icositetrahedron": 509314}
ABSENT = ("RindStrips", "OrganicSphere", "Venus", "TeaPot", "FatherStrength", "QueenAnneChair", "Art3dprint")
ABSENT = (*ABSENT, "Art3dprint2", "Mushroom")


def generated(mesh: tuple[np.ndarray, np.ndarray]) -> Mesh:
    """A mesh of `topokit.testing` with its vertices as they are."""
    return Mesh(*mesh, process=False)


def network(path: Path) -> Callable[[Tensor], Tensor]:
    """A signed distance perceptron from an .npz of weights and biases in order; ReLU, or ELU if the file says so."""
    stored = np.load(path)
    names = [name for name in stored.files if stored[name].size]
    weights = [torch.from_numpy(stored[name]).double() for name in names if stored[name].ndim == 2]
    biases = [torch.from_numpy(stored[name]).double() for name in names if stored[name].ndim == 1]
    bend = torch.nn.functional.elu if any("elu" in name for name in stored.files) else torch.relu

    def value(points: Tensor) -> Tensor:
        layer = points.double()
        for number, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            layer = layer @ weight + bias
            layer = bend(layer) if number < len(weights) - 1 else layer
        return layer.squeeze(-1)

    return value


def network_mesh(path: Path) -> Mesh:
    """The zero level set of a network in [−1, 1]³ by marching cubes."""
    distance = network(path)
    ticks = torch.linspace(-1, 1, _GRID + 1, dtype=torch.float64)
    plane = torch.cartesian_prod(ticks, ticks)
    with torch.no_grad():
        slices = [distance(torch.cat((x.expand(len(plane), 1), plane), dim=1)) for x in ticks]
    field = torch.stack(slices).reshape(_GRID + 1, _GRID + 1, _GRID + 1).numpy()
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(2 / _GRID,) * 3, gradient_direction="descent")
    return Mesh(vertices - 1, faces, process=False)


def read(path: Path) -> Mesh:
    """A mesh as topokit opens it."""
    mesh = tk.from_mesh(path).mesh
    assert mesh is not None
    return Mesh(mesh[0].numpy(), mesh[1].numpy(), process=False)


def rows(data: Path | None, thingi10k: Path | None) -> Iterator[Row]:
    """All rows of Table II for which there is something to measure, then those for which there is nothing."""
    taken = set()
    for name, (number, euler) in THINGI10K.items():
        found = sorted(thingi10k.glob(f"{number}.*")) if thingi10k else []
        if found:
            taken.add(name)
            yield Row(name, "T", euler, lambda path=found[0]: read(path))
    yield Row("Icosphere", "A′", 2, lambda: generated(icosphere(4)))
    tubes = (("TriakisTetrahedron", -20, triakis_tetrahedron), ("Icositetrahedron", -44, deltoidal_icositetrahedron))
    for name, euler, frame in tubes:
        if name not in taken:
            yield Row(name, "C", euler, lambda frame=frame: generated(edge_tubes(frame())), "tubes along its edges")
    yield Row("Knot", "C", 0, lambda: generated(torus_knot()), "a trefoil")
    if data is None:
        absent = ("Kitten", "Genus6surface", "HolesSculpture", "Bunny", *NETWORKS)
    else:
        yield from _stored(data, taken)
        absent = ()
    for name in dict.fromkeys((*absent, *ABSENT)):
        if name not in taken:
            yield Row(name, "D", 0, None)


def _stored(data: Path, taken: set[str]) -> Iterator[Row]:
    meshes, networks = data / "meshes", data / "sdfnets"
    yield Row("Kitten", "A", 0, lambda: read(meshes / "paper_Kitten.obj"))
    yield Row("Genus6surface", "A", -10, lambda: read(meshes / "paper_Genus6.obj"))
    for name, euler in NETWORKS.items():
        if name not in taken:
            path = networks / f"thingi10k_{NETWORK_FILES[name]}.npz"
            yield Row(name, "B", euler, lambda path=path: network_mesh(path))
    yield Row("Bunny", "C", 2, lambda: network_mesh(networks / "niq_bunny.npz"), "a network of the closed bunny")
    if "HolesSculpture" not in taken:
        yield Row("HolesSculpture", "C", -264, lambda: read(meshes / "cgal_cheese.off"), "another with χ = −264")


def clean_meshes(data: Path) -> list[tuple[str, int, Path]]:
    """Name, χ and file of all clean closed meshes of genus below 1 000."""
    index = json.loads((data / "index.json").read_text(encoding="utf-8"))
    clean = [row for row in index if row["kind"] == "mesh" and row.get("clean_truth") and row["genus"] < 1000]
    return [(row["name"], row["chi"], data / row["path"]) for row in clean]


def samples(
    mesh: Mesh, n_points: int, seed: int, noise: float = 0.0, with_vertices: bool = False
) -> tuple[Tensor, Tensor]:
    """Random points by area in [−1, 1]³ with noise and their normals; if wanted, all vertices with theirs, too."""
    points, face = trimesh.sample.sample_surface(mesh, n_points, seed=seed)
    points, normals = np.asarray(points, dtype=np.float64), mesh.face_normals[face]
    if with_vertices:
        points, normals = np.concatenate((points, mesh.vertices)), np.concatenate((normals, mesh.vertex_normals))
    low, high = mesh.bounds
    points = 2 * (points - (low + high) / 2) / (high - low).max()
    points = points + noise * np.random.default_rng(seed).normal(size=points.shape)
    return torch.from_numpy(points), torch.from_numpy(normals.copy())
