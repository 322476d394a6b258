"""Places of a shape become marks: handles, boundaries and defects, and nothing where the question has no meaning."""

from __future__ import annotations

import numpy as np
import pytest

import topokit as tk
from topokit.export.scene import Mark, marks_of
from topokit.pages import page_of
from topokit.testing import genus_mesh, icosphere, sphere_samples, torus_mesh
from topokit.testing.meshes import joined


def marks(shape: tk.Shape) -> tuple[Mark, ...]:
    return marks_of(shape.report(locate=True).location)


def kinds(found: tuple[Mark, ...]) -> list[str]:
    return [mark.kind for mark in found]


def test_every_handle_has_two_loops_of_the_lengths_that_it_tells() -> None:
    shape = tk.from_mesh(genus_mesh(2, resolution=12))
    found = marks(shape)
    assert kinds(found) == ["handle", "tunnel"] * 2
    for number, handle in enumerate(shape.handles()):
        assert found[2 * number].length == pytest.approx(handle.handle_length)
        assert found[2 * number + 1].length == pytest.approx(handle.tunnel_length)


def test_an_open_mesh_has_boundaries_and_no_handles() -> None:
    vertices, faces = torus_mesh()
    found = marks(tk.from_mesh(vertices, faces[1:]))
    assert kinds(found) == ["boundary"]
    assert len(found[0].points) == 3
    assert found[0].form == "loop"


def test_a_pinched_vertex_is_a_dot_where_it_is() -> None:
    vertices, faces = joined(icosphere(1), icosphere(1))
    n = len(vertices) // 2
    touching = int(vertices[:n, 2].argmax())
    moved = vertices.copy()
    lowest = n + int(vertices[n:, 2].argmin())
    moved[n:] += vertices[touching] - vertices[lowest]
    faces = np.where(faces == lowest, touching, faces)
    found = [mark for mark in marks(tk.from_mesh(moved, faces)) if mark.label == "pinched vertex"]
    assert [mark.form for mark in found] == ["dots"]
    np.testing.assert_allclose(found[0].center, vertices[touching], atol=1e-6)


def test_points_without_a_surface_have_no_marks_but_a_page() -> None:
    line = sphere_samples(200).points * 0 + sphere_samples(200).points[:, :1]
    shape = tk.from_points(line + 1e-3 * sphere_samples(200).points)
    assert page_of(shape, shape.report(locate=True)).details


def test_only_so_many_are_shown() -> None:
    most = 30
    spheres = joined(*(icosphere(0) for _ in range(most + 10)))
    torn = np.delete(spheres[1], np.arange(0, len(spheres[1]), 20), axis=0)
    location = tk.from_mesh(spheres[0], torn).report(locate=True).location
    assert kinds(marks_of(location, most)).count("boundary") == most
    assert kinds(marks_of(location, None)).count("boundary") == most + 10
