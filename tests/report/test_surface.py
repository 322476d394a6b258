"""The surface behind a report: closed, outward, and counting to the reported integer; or an error that says why not."""

from __future__ import annotations

import numpy as np
import pytest

import topokit as tk
from topokit.errors import InputError
from topokit.testing import genus_mesh, icosphere, shell_mesh, torus_mesh
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
