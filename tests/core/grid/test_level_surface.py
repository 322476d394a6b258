"""Surfaces of solids on grids: closed, outward, with exactly the counted topology, and where the values put them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
import trimesh
from analytic_fields import ball, block, grid, torus, without
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from torch import Tensor

from topokit.core.blocks.whole import count_solid
from topokit.core.grid.cube_table import EDGES, cube_triangles
from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import Grid
from topokit.core.grid.level_surface import level_surface
from topokit.core.mesh.topology import MeshTopology, mesh_topology
from topokit.core.surface import TriangleSurface

connectivities = st.sampled_from((6, 26))
volumes = arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=6))


def counted(surface: TriangleSurface) -> MeshTopology:
    return mesh_topology(surface.vertices, surface.faces)


def surface_of(inside: Tensor, connectivity: int) -> TriangleSurface:
    x, y, z = inside.shape
    return level_surface(inside.double() - 0.5, Grid((x, y, z)), connectivity)


@given(volumes, connectivities)
@settings(deadline=None)
def test_surfaces_of_random_volumes_have_the_counted_topology(volume: np.ndarray, connectivity: int) -> None:
    inside = torch.from_numpy(volume)
    if not inside.any():
        return
    topology = counted(surface_of(inside, connectivity))
    assert topology.is_closed
    assert topology.flipped_faces == topology.inward_components == 0
    assert topology.euler == int(surface_euler(inside, 0, connectivity))
    walls = count_solid(inside, lambda part: part, connectivity, Grid(tuple(inside.shape))).surfaces
    assert sorted(topology.components.euler) == sorted(walls.euler)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_every_case_of_a_cell_has_the_counted_topology(connectivity: int) -> None:
    for case in range(1, 256):
        inside = torch.tensor([bool(case >> corner & 1) for corner in range(8)]).reshape(2, 2, 2)
        topology = counted(surface_of(inside, connectivity))
        assert topology.is_closed, case
        assert topology.euler == int(surface_euler(inside, 0, connectivity)), case


def test_no_triangle_has_a_side_across_a_face_of_its_cell() -> None:
    """Such a side could be that of a triangle in the next cell, too, and have four faces then."""
    on_face = [{(axis, a >> axis & 1) for axis in range(3) if a >> axis & 1 == b >> axis & 1} for a, b in EDGES]
    for connectivity in (6, 26):
        triangles, starts = cube_triangles(connectivity)
        for case in range(256):
            own = triangles[starts[case] : starts[case + 1]]
            sides = [frozenset(side) for face in own for side in itertools.combinations(face.tolist(), 2)]
            for side in set(sides):
                first, second = side
                assert sides.count(side) == (1 if on_face[first] & on_face[second] else 2), (connectivity, case)


def test_connectivity_decides_whether_diagonal_voxels_are_joined() -> None:
    for second, joined in (((1, 1, 0), 2), ((1, 1, 1), 2)):
        inside = torch.zeros(2, 2, 2, dtype=torch.bool)
        inside[0, 0, 0] = inside[second] = True
        assert counted(surface_of(inside, 26)).euler == joined
        assert counted(surface_of(inside, 6)).euler == 4


def test_vertices_lie_where_the_values_vanish() -> None:
    n = 33
    field = torus(grid(n), 0.6, 0.25)
    surface = level_surface(field, Grid((n, n, n), (2 / (n - 1),) * 3, (-1.0, -1.0, -1.0)), 26)
    off = torus(torch.from_numpy(surface.vertices), 0.6, 0.25)
    assert float(off.abs().max()) < 0.1 * 2 / (n - 1)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(2 * math.pi**2 * 0.6 * 0.25**2, rel=0.02)
    assert mesh.euler_number == 0


def test_the_surface_is_given_in_units_of_length_and_closed_half_a_step_beyond_the_border() -> None:
    surface = level_surface(torch.ones(2, 3, 4), Grid((2, 3, 4), (1.0, 2.0, 0.5), (10.0, 20.0, 30.0)), 6)
    np.testing.assert_allclose(surface.vertices.min(axis=0), [9.5, 19.0, 29.75])
    np.testing.assert_allclose(surface.vertices.max(axis=0), [11.5, 25.0, 31.75])


def test_infinite_and_missing_values_and_values_on_the_level_leave_no_degenerate_triangle() -> None:
    field = without(ball(grid(12), 0.8), block(grid(12), (0.2, 0.2, 2.0)))
    field[field.abs() < 0.1] = 0.0
    field[0], field[:, 0] = -torch.inf, torch.nan
    field[6, 6, 1] = torch.inf
    surface = level_surface(field, Grid((12, 12, 12)), 6)
    topology = counted(surface)
    assert topology.is_closed
    assert topology.euler == int(surface_euler(field, 0, 6))
    assert trimesh.Trimesh(surface.vertices, surface.faces, process=False).area_faces.min() > 0


def test_slabs_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    field = torus(grid(20), 0.6, 0.25)
    whole = level_surface(field, Grid((20, 20, 20)), 26)
    monkeypatch.setattr("topokit.core.grid.level_surface._SLAB", 1000)
    parts = level_surface(field, Grid((20, 20, 20)), 26)
    np.testing.assert_array_equal(whole.faces, parts.faces)
    np.testing.assert_array_equal(whole.vertices, parts.vertices)
