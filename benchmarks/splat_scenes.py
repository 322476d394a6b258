"""Closed meshes as Gaussian splats: discs on random places, spun, turned over, lifted, of varied size and opacity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import topokit as tk

Floats = NDArray[np.float64]

THIN = 0.03  # smallest scale of a splat over its spacing


@dataclass(frozen=True)
class Style:
    """How a surface is covered by splats.

    Attributes:
        overlap: standard deviation of a disc over the spacing of the splats, √(area / count).
        spread: factor by which single scales are larger or smaller, at most.
        jitter: standard deviation of the heights above the surface, in spacings.
        faintest: opacities lie between this and 1.
        even: whether splats keep a distance, as after training; else they are independent.
    """

    overlap: float = 0.7
    spread: float = 1.3
    jitter: float = 0.05
    faintest: float = 0.6
    even: bool = False


def discs_on(mesh: trimesh.Trimesh, count: int, style: Style, rng: np.random.Generator) -> tk.GaussianSplats:
    """Splats on the surface of a mesh."""
    draw = trimesh.sample.sample_surface_even if style.even else trimesh.sample.sample_surface
    places, face = draw(mesh, count, seed=int(rng.integers(1 << 31)))
    return splats_at(np.asarray(places), mesh.face_normals[face], float(np.sqrt(mesh.area / len(places))), style, rng)


def splats_at(
    places: Floats, normals: Floats, spacing: float, style: Style, rng: np.random.Generator
) -> tk.GaussianSplats:
    """Splats around places (N, 3) with unit normals (N, 3)."""
    count = len(places)
    axis = normals * rng.choice([-1.0, 1.0], size=(count, 1))
    side = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    spin = rng.uniform(0, 2 * np.pi, (count, 1))
    first = np.cos(spin) * side + np.sin(spin) * np.cross(axis, side)
    turn = np.stack((first, np.cross(axis, first), axis), axis=2)
    width = spacing * style.overlap * style.spread ** rng.uniform(-1, 1, (count, 2))
    parts = (
        places + axis * rng.normal(size=(count, 1)) * style.jitter * spacing,
        np.column_stack((width, np.full(count, THIN * spacing))),
        Rotation.from_matrix(turn).as_quat()[:, [3, 0, 1, 2]],
        rng.uniform(style.faintest, 1, count),
    )
    return tk.GaussianSplats(*(torch.from_numpy(np.ascontiguousarray(part)) for part in parts))
