"""What every export shows: colors symmetric about zero, unit normals, curvature interpolated at vertices."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

import topokit as tk
from topokit.errors import InputError
from topokit.export.colors import colored_surface, diverging_colors
from topokit.testing import icosphere, sphere_samples, torus_mesh


def test_colors_run_from_blue_through_white_to_red_and_are_symmetric() -> None:
    colors = diverging_colors(np.linspace(-1, 1, 101)).astype(int)
    np.testing.assert_array_equal(colors[[0, 50, 100]], [[33, 102, 172], [247, 247, 247], [178, 24, 43]])
    distance = np.abs(colors - 247).sum(axis=1)
    assert (np.diff(distance[:51]) <= 0).all()
    assert (np.diff(distance[50:]) >= 0).all()
    assert (diverging_colors(np.zeros(5)) == 247).all()


def test_one_peak_does_not_wash_out_the_rest() -> None:
    values = np.ones(100)
    values[0] = 1e6
    np.testing.assert_array_equal(diverging_colors(values), np.tile([178, 24, 43], (100, 1)))


def test_a_cloud_keeps_its_points() -> None:
    known = sphere_samples(500)
    surface = colored_surface(tk.from_points(known.points, 3 * known.normals))
    assert surface.faces is None
    np.testing.assert_array_equal(surface.positions, known.points.numpy())
    np.testing.assert_allclose(surface.normals, known.normals.numpy(), atol=1e-12)
    assert np.median(surface.fields["gaussian"]) == pytest.approx(1, abs=0.1)


def test_a_mesh_takes_the_values_of_the_samples_around_its_vertices() -> None:
    vertices, faces = torus_mesh()
    surface = colored_surface(tk.from_mesh((vertices, faces)), "mean")
    np.testing.assert_array_equal(surface.positions, vertices)
    np.testing.assert_array_equal(surface.faces, faces)
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1)
    distance = np.hypot(*vertices.T[:2])
    exact = (1 / 0.4 + (distance - 1) / 0.4 / distance) / 2
    assert np.median(np.abs(surface.fields["mean"] / exact - 1)) < 0.1


def test_fewer_samples_than_a_vertex_would_have_neighbors() -> None:
    surface = colored_surface(tk.from_mesh(icosphere(1), n_samples=5, n_neighbors=3))
    assert all(np.isfinite(values).all() for values in surface.fields.values())


def test_vertices_of_no_face_may_be_anywhere() -> None:
    vertices, faces = icosphere(2)
    surface = colored_surface(
        tk.from_mesh((np.concatenate((vertices, [[np.nan] * 3, [9.0, 9, 9]])), faces), n_samples=500)
    )
    np.testing.assert_array_equal(surface.positions, vertices)
    np.testing.assert_array_equal(surface.faces, faces)
    assert all(np.isfinite(values).all() for values in surface.fields.values())


def test_vertices_that_were_merged_are_written_once() -> None:
    vertices, faces = icosphere(2)
    corners = tk.from_mesh(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3), n_samples=500)
    surface = colored_surface(corners)  # as an STL file holds it
    assert len(surface.positions) == len(vertices)
    assert surface.faces is not None
    assert trimesh.Trimesh(surface.positions, surface.faces, process=False).is_watertight


def test_batches_are_refused() -> None:
    with pytest.raises(InputError) as caught:
        colored_surface(tk.from_points(torch.stack([sphere_samples(100).points] * 2)))
    assert str(caught.value) == (
        "one shape is exported at a time; the samples are batched, (2, 100, 3). Make a shape of each item."
    )
