"""Open surfaces: found, located, and their Euler characteristic with the boundary's turning."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

import topokit as tk
from topokit.testing import icosphere, sphere_samples, torus_samples

N = 4000


def cloud(name: str) -> tuple[Tensor, Tensor]:
    random = torch.Generator().manual_seed(1)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64)

    if name in ("hemisphere", "cap"):
        sphere = sphere_samples(2 * N, generator=random)
        kept = sphere.points[:, 2] > (0.0 if name == "hemisphere" else 0.6)
        return sphere.points[kept], sphere.normals[kept]
    if name == "cylinder":
        angle, height = 2 * math.pi * uniform(N), 2 * uniform(N)
        normals = torch.stack((angle.cos(), angle.sin(), torch.zeros_like(angle)), dim=1)
        return normals + height[:, None] * torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64), normals
    if name == "half torus":
        torus = torus_samples(2 * N, generator=random)
        kept = torus.points[:, 0] > 0
        return torus.points[kept], torus.normals[kept]
    flat = 2 * uniform(N, 2) - 1
    if name == "square with a hole":
        flat = flat[flat.norm(dim=1) > 0.5]
    points = torch.cat((flat, torch.zeros(len(flat), 1, dtype=torch.float64)), dim=1)
    return points, torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(points.shape)


SURFACES = {
    "hemisphere": (1, 1),
    "cap": (1, 1),
    "square": (1, 1),
    "cylinder": (0, 2),
    "square with a hole": (0, 2),
    "half torus": (0, 2),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("with_normals", [True, False])
def test_open_surfaces(name: str, with_normals: bool) -> None:
    euler, loops = SURFACES[name]
    points, normals = cloud(name)
    shape = tk.from_points(points, normals if with_normals else None)
    report = shape.report()
    assert (report.euler, report.closed, report.genus, report.verdict) == (euler, False, None, "unsure")
    assert report.boundary_loops == loops
    assert report.estimate == pytest.approx(euler, abs=0.3)
    assert any("The surface is not closed: its boundary runs along" in reason for reason in report.reasons)
    assert abs(float(shape.euler()) - euler) < 0.3


def test_where_it_is_open_is_said() -> None:
    points, normals = cloud("hemisphere")
    report = tk.from_points(points, normals).report()
    sentence = next(reason for reason in report.reasons if "not closed" in reason)
    length = float(sentence.split("of length ")[1].split()[0])
    assert length == pytest.approx(2 * math.pi, rel=0.05)
    low = sentence.split("between (")[1].split(")")[0].split(", ")
    assert float(low[0]) == pytest.approx(-1, abs=0.05)
    assert float(low[2]) == pytest.approx(0, abs=0.1)


def test_closed_surfaces_have_no_boundary() -> None:
    for known in (sphere_samples(4000), torus_samples(4000)):
        report = tk.from_points(known.points).report()
        assert report.closed
        assert report.boundary_loops == 0


def test_an_open_mesh_meets_its_exact_number() -> None:
    vertices, faces = icosphere(4)
    upper = (vertices[faces].mean(1)[:, 2] > 0.2).nonzero()[0]
    shape = tk.from_mesh((vertices, faces[upper]))
    assert shape.report().euler == 1
    assert abs(float(shape.euler()) - 1) < 1e-3
