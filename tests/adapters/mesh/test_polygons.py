"""Faces in every form as triangles."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.adapters.mesh.polygons import fans, triangles

N_SIDES = 7
ANGLE = 2 * np.pi * np.arange(N_SIDES) / N_SIDES
PRISM = np.concatenate([np.c_[np.cos(ANGLE), np.sin(ANGLE), np.full(N_SIDES, z)] for z in (0.0, 1.0)])
SIDES = [[i, (i + 1) % N_SIDES, (i + 1) % N_SIDES + N_SIDES, i + N_SIDES] for i in range(N_SIDES)]
CAPS = [list(range(N_SIDES))[::-1], list(range(N_SIDES, 2 * N_SIDES))]


def test_a_fan_shares_its_first_corner() -> None:
    corners = np.array([4, 5, 6, 0, 1, 2, 3, 9, 8, 7, 6, 5])
    expected = [[4, 5, 6], [0, 1, 2], [0, 2, 3], [9, 8, 7], [9, 7, 6], [9, 6, 5]]
    assert fans(corners, np.array([3, 4, 5])).tolist() == expected


@pytest.mark.parametrize(
    "faces",
    [
        SIDES + CAPS,
        tuple(tuple(row) for row in SIDES + CAPS),
        [np.array(row) for row in SIDES + CAPS],
        np.array([row + [-1] * (N_SIDES - len(row)) for row in SIDES + CAPS]),
        torch.tensor([row + [-1] * (N_SIDES - len(row)) for row in SIDES + CAPS]),
    ],
    ids=["lists", "tuples", "arrays", "padded", "padded tensor"],
)
def test_a_prism_in_every_form(faces: object) -> None:
    found = triangles(faces)
    assert found.dtype == np.int64
    assert len(found) == 2 * N_SIDES + 2 * (N_SIDES - 2)
    shape = tk.from_mesh(PRISM, faces, n_samples=100)  # type: ignore[arg-type]
    assert (shape.genus(), shape.report().euler, shape.report().verdict) == (0, 2, "certain")


def test_quads_of_a_torus() -> None:
    n, m = 12, 8
    i, j = (part.ravel() for part in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    quads = np.stack((i * m + j, (i + 1) % n * m + j, (i + 1) % n * m + (j + 1) % m, i * m + (j + 1) % m), axis=1)
    u, v = 2 * np.pi * i / n, 2 * np.pi * j / m
    vertices = np.c_[(2 + np.cos(v)) * np.cos(u), (2 + np.cos(v)) * np.sin(u), np.sin(v)]
    for faces in (quads, quads.astype(np.uint32), quads.tolist()):
        assert tk.from_mesh(vertices, faces, n_samples=100).genus() == 1


def test_a_quad_that_repeats_its_last_corner_is_a_triangle() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1, 1], [0, 1, 3, 3], [0, 3, 2, 2], [1, 2, 3, 3]])
    report = tk.from_mesh(vertices, faces, n_samples=100).report()
    assert (report.euler, report.verdict) == (2, "certain")
    assert "Not counted: 4 faces with a repeated vertex." in report.reasons
