"""The surface behind a report: closed, outward, and counting to the reported integer; or an error that says why not."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import torch
import trimesh
from analytic_fields import grid, torus
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

import topokit as tk
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError
from topokit.shape.surface import checked_surface
from topokit.testing import genus_mesh, icosphere, shell_mesh, sphere_samples, torus_mesh, torus_samples
from topokit.testing.meshes import Mesh

MESHES = {"sphere": icosphere(2), "torus": torus_mesh(20, 10), "genus 4": genus_mesh(4, 12), "shell": shell_mesh(2)}


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())
def test_the_surface_of_a_mesh_is_the_mesh(mesh: Mesh) -> None:
    shape = tk.from_mesh(mesh)
    surface = shape.surface()
    np.testing.assert_array_equal(surface.vertices, mesh[0])
    np.testing.assert_array_equal(surface.faces, mesh[1])
    assert surface.euler_number == shape.report().euler
    assert surface.is_watertight
    assert surface.is_winding_consistent


def test_the_surface_of_an_inside_out_mesh_faces_outward_and_uses_all_of_its_vertices() -> None:
    vertices, faces = icosphere(2)
    surface = tk.from_mesh(np.vstack((vertices, [[9.0, 9, 9]])), faces[:, ::-1]).surface()
    assert surface.volume > 0
    assert len(surface.vertices) == len(vertices)


def test_the_surface_of_loose_triangles_is_joined() -> None:
    vertices, faces = torus_mesh(12, 8)
    surface = tk.from_mesh(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)).surface()
    assert surface.is_watertight
    assert len(surface.vertices) == len(vertices)
    assert surface.euler_number == 0


def test_an_open_mesh_has_no_closed_surface() -> None:
    vertices, faces = icosphere(2)
    with pytest.raises(InputError, match=r"no closed surface.*1 boundary loop"):
        tk.from_mesh(vertices, faces[1:]).surface()


def check(shape: tk.Shape) -> trimesh.Trimesh:
    """The surface of a shape, with the reported topology."""
    surface = shape.surface()
    assert surface.euler_number == shape.report().euler
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert surface.volume > 0
    return surface


@given(arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=5)), st.sampled_from((6, 26)))
@settings(deadline=None, max_examples=25)
def test_the_surface_of_a_volume_has_its_connectivity(volume: np.ndarray, connectivity: int) -> None:
    if volume.any():
        check(tk.from_voxels(volume, connectivity=connectivity, spacing=(1, 2, 0.5)))


def test_the_surface_of_gray_values_lies_between_the_voxels() -> None:
    field = torus(grid(24), 0.6, 0.25)
    shape = tk.from_voxels(field, level=0.0, spacing=2 / 23, origin=(-1, -1, -1))
    surface = check(shape)
    assert float(torus(torch.tensor(surface.vertices), 0.6, 0.25).abs().max()) < 0.01
    assert pickle.loads(pickle.dumps(shape)).surface().euler_number == 0


@pytest.mark.parametrize("minor", [0.25, 0.04])
def test_the_vertices_of_a_function_lie_on_its_level_set(minor: float) -> None:
    surface = check(
        tk.from_sdf(
            lambda p: -(torus(p, 0.6, minor) ** 3) - torus(p, 0.6, minor), resolution=128 if minor > 0.1 else 256
        )
    )
    off = torus(torch.tensor(surface.vertices), 0.6, minor).abs()
    step = 2 / 64
    assert float(off.quantile(0.9)) < 1e-5 * step
    assert float(off.max()) < 1.1e-3 * step  # vertices keep away from the ends of their grid edges


def test_the_surface_of_a_function_that_reaches_its_box_is_not_closed() -> None:
    with pytest.raises(InputError, match=r"has no closed surface.*reaches the box"):
        tk.from_sdf(lambda p: p[:, 2], bounds=((-1, -1, -1), (1, 1, 1)), resolution=128).surface()


def test_the_surface_of_a_cloud_joins_its_points() -> None:
    known = torus_samples(1500)
    for shape in (tk.from_points(known.points, known.normals), tk.from_points(known.points)):
        surface = check(shape)
        assert surface.euler_number == 0
        given_points = {tuple(point) for point in known.points.tolist()}
        assert all(tuple(vertex) in given_points for vertex in surface.vertices.tolist())


def test_the_surface_of_an_open_cloud_ends_at_its_rims() -> None:
    ball = sphere_samples(1200).points
    belt = tk.from_points(ball[ball[:, 2].abs() < 0.7])
    surface, report = belt.surface(), belt.report()
    assert (report.closed, report.euler, report.boundary_loops) == (False, 0, 2)
    again = tk.from_mesh(surface).report()
    assert (again.euler, again.components, again.boundary_loops, again.flipped) == (0, 1, 2, 0)
    assert ((surface.face_normals * surface.triangles_center).sum(axis=1) > 0).mean() > 0.99  # but for slivers
    assert surface.area == pytest.approx(4 * np.pi * 0.7, rel=0.1)  # Archimedes: as much as the cylinder around it
    with pytest.raises(InputError, match="has no closed surface"):
        belt.handles()


def test_points_in_a_plane_have_no_surface() -> None:
    flat = torch.rand(200, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([1.0, 1.0, 0.0])
    with pytest.raises(InputError, match="has no closed surface"):
        tk.from_points(flat).surface()


def test_a_surface_that_contradicts_the_report_is_refused() -> None:
    report = tk.from_mesh(torus_mesh(20, 10)).report()
    with pytest.raises(InputError, match="counts to χ = 2, but χ = 0"):
        checked_surface(report, TriangleSurface(*icosphere(1)))
    with pytest.raises(InputError, match="is not a closed manifold"):
        checked_surface(report, TriangleSurface(icosphere(1)[0], icosphere(1)[1][1:]))
    with pytest.raises(InputError, match="has no closed surface"):
        checked_surface(report, None)
