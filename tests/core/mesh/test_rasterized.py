"""The solid of a mesh on a grid: analytic solids, and surfaces that run exactly through grid lines."""

from __future__ import annotations

import numpy as np
import trimesh

from topokit.core.grid.grid import Grid
from topokit.core.mesh.rasterized import rasterized

GRID = Grid((21, 21, 21), (0.1, 0.1, 0.1), (-1.0, -1.0, -1.0))
X, Y, Z = np.meshgrid(*[np.linspace(-1, 1, 21)] * 3, indexing="ij")


def test_a_ball_inside_a_hollow_ball() -> None:
    balls = [trimesh.creation.icosphere(4, radius=radius) for radius in (0.93, 0.73, 0.41)]
    found = rasterized(*merged(balls), GRID)
    radius = np.sqrt(X**2 + Y**2 + Z**2)
    expected = (radius < 0.93) & (radius > 0.73) | (radius < 0.41)
    sure = np.min([np.abs(radius - level) for level in (0.93, 0.73, 0.41)], axis=0) > 0.01
    np.testing.assert_array_equal(found[sure], expected[sure])


def test_edges_and_vertices_on_grid_lines_are_crossed_once() -> None:
    """The corners of a cube, and the diagonals of its faces, lie on lines of the grid."""
    grid = Grid((9, 9, 9))
    cube = trimesh.creation.box(bounds=((2, 2, 2), (6, 6, 6)))
    found = rasterized(np.asarray(cube.vertices), np.asarray(cube.faces), grid)
    assert found[3:6, 3:6, 3:6].all()
    assert not found[:2].any()
    assert not found[7:].any()
    assert not found[..., 7:].any()
    assert found.sum() == 4**3


def merged(meshes: list[trimesh.Trimesh]):
    both = trimesh.util.concatenate(meshes)
    return np.asarray(both.vertices), np.asarray(both.faces)
