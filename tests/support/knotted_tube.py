"""A trefoil as a tube, for tests of loops that have to wind around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.testing import torus_mesh
from topokit.testing.meshes import Mesh


def knotted_tube(around: int, tube: int, radius: float = 0.25) -> tuple[Mesh, NDArray[np.float64]]:
    """A closed tube around a trefoil, facing outward, and its core (around, 3).

    Vertex i · tube + j is vertex j of cross-section i. Cross-sections do not turn against the vertical, so rows of
    vertices along the tube link it three times, which is the number of crossings seen from above.
    """
    t = np.arange(around) * 2 * np.pi / around
    core = np.stack((np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)), axis=1)
    ahead = np.roll(core, -1, axis=0) - np.roll(core, 1, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    up = np.array([0, 0, 1.0]) - ahead[:, 2:] * ahead
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    angle = (np.arange(tube) * 2 * np.pi / tube)[None, :, None]
    rings = np.cos(angle) * up[:, None] + np.sin(angle) * np.cross(ahead, up)[:, None]
    return ((core[:, None] + radius * rings).reshape(-1, 3), torus_mesh(around, tube)[1][:, ::-1]), core
