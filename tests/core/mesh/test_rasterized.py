"""The solid of a mesh on a grid: analytic solids, and surfaces that run exactly through grid lines."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from topokit.core.grid.grid import Grid
from topokit.core.mesh.rasterized import rasterized
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError

GRID = Grid((21, 21, 21), (0.1, 0.1, 0.1), (-1.0, -1.0, -1.0))
X, Y, Z = np.meshgrid(*[np.linspace(-1, 1, 21)] * 3, indexing="ij")


def test_a_ball_inside_a_hollow_ball() -> None:
    balls = [trimesh.creation.icosphere(4, radius=radius) for radius in (0.93, 0.73, 0.41)]
    balls[1].invert()
    radius = np.sqrt(X**2 + Y**2 + Z**2)
    expected = (radius < 0.93) & (radius > 0.73) | (radius < 0.41)
    sure = np.min([np.abs(radius - level) for level in (0.93, 0.73, 0.41)], axis=0) > 0.01
    np.testing.assert_array_equal(rasterized(merged(balls), GRID)[sure], expected[sure])


def test_overlapping_parts_enclose_their_union() -> None:
    cubes = [
        trimesh.creation.box(bounds=((-0.85,) * 3, (0.35,) * 3)),
        trimesh.creation.box(bounds=((-0.35,) * 3, (0.85,) * 3)),
    ]
    lowest, highest = np.minimum(np.minimum(X, Y), Z), np.maximum(np.maximum(X, Y), Z)
    expected = (lowest > -0.85) & (highest < 0.35) | (lowest > -0.35) & (highest < 0.85)
    np.testing.assert_array_equal(rasterized(merged(cubes), GRID), expected)


def test_edges_and_vertices_on_grid_lines_are_crossed_once() -> None:
    """The corners of a cube, and the diagonals of its faces, lie on lines of the grid."""
    found = rasterized(merged([trimesh.creation.box(bounds=((2, 2, 2), (6, 6, 6)))]), Grid((9, 9, 9)))
    assert found[3:6, 3:6, 3:6].all()
    assert not found[:2].any()
    assert not found[7:].any()
    assert not found[..., 7:].any()
    assert found.sum() == 4**3


def test_an_open_surface_is_refused() -> None:
    cube = merged([trimesh.creation.box(bounds=((2, 2, 2), (6, 6, 6)))])
    without_its_top = TriangleSurface(cube.vertices, cube.faces[(cube.vertices[cube.faces][:, :, 2] < 6).any(1)])
    with pytest.raises(InputError, match="not closed"):
        rasterized(without_its_top, Grid((9, 9, 9)))


def merged(meshes: list[trimesh.Trimesh]) -> TriangleSurface:
    both = trimesh.util.concatenate(meshes)
    return TriangleSurface(np.asarray(both.vertices), np.asarray(both.faces))
