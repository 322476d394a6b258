"""Shapes as PLY files and meshes of trimesh: the same points, faces, fields and colors as everywhere."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from plyfile import PlyData

import topokit as tk
import topokit.export
from topokit.errors import InputError
from topokit.export import save_ply, to_trimesh
from topokit.export.colors import colored_surface
from topokit.testing import sphere_samples, torus_mesh

FIELDS = ("gaussian", "mean", "total", "k_min", "k_max", "area")
VERTICES, FACES = torus_mesh(40, 20)


def test_a_mesh_is_saved_with_its_faces_colors_and_fields(tmp_path: Path) -> None:
    shape = tk.from_mesh((VERTICES, FACES))
    assert save_ply(shape, tmp_path / "torus.ply", color_by="mean") == len(VERTICES)
    written = PlyData.read(str(tmp_path / "torus.ply"))
    expected = colored_surface(shape, "mean")
    vertex = written["vertex"].data
    np.testing.assert_array_equal(np.stack([vertex[axis] for axis in "xyz"], axis=1), VERTICES)
    np.testing.assert_array_equal(np.stack(written["face"].data["vertex_indices"]), FACES)
    np.testing.assert_array_equal(np.stack([vertex[name] for name in ("red", "green", "blue")], 1), expected.colors)
    for name in FIELDS:
        np.testing.assert_array_equal(vertex[name], expected.fields[name].astype(np.float32))
    assert tk.load(tmp_path / "torus.ply").genus() == 1


def test_a_cloud_is_saved_and_read_again_with_its_normals(tmp_path: Path) -> None:
    known = sphere_samples(300)
    assert save_ply(tk.from_points(known.points, known.normals), tmp_path / "sphere.ply") == 300
    again = tk.load(tmp_path / "sphere.ply").samples
    assert torch.equal(again.points, known.points)
    assert again.normals is not None
    torch.testing.assert_close(again.normals, known.normals, rtol=0, atol=1e-6)


def test_trimesh_gets_the_mesh_with_curvature_at_its_vertices() -> None:
    shape = tk.from_mesh((VERTICES, FACES))
    mesh = to_trimesh(shape)
    assert isinstance(mesh, trimesh.Trimesh)
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    np.testing.assert_array_equal(mesh.faces, FACES)
    assert set(mesh.vertex_attributes) == set(FIELDS)
    expected = colored_surface(shape)
    np.testing.assert_array_equal(mesh.vertex_attributes["gaussian"], expected.fields["gaussian"])
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], expected.colors)
    assert tk.from_mesh(mesh).genus() == 1


def test_the_bare_mesh_costs_no_curvature(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = tk.from_mesh((torch.from_numpy(VERTICES).requires_grad_(), torch.from_numpy(FACES)))
    monkeypatch.setattr(tk.Shape, "curvature", None)
    mesh = to_trimesh(shape, color_by=None)
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    np.testing.assert_array_equal(mesh.faces, FACES)
    assert len(mesh.vertex_attributes) == 0


def test_what_cannot_be_exported_is_explained(tmp_path: Path) -> None:
    cloud = tk.from_points(sphere_samples(100).points)
    with pytest.raises(
        InputError, match=r"was not made from a mesh, so there is none to export; save_ply and to_open3d"
    ):
        to_trimesh(cloud)
    with pytest.raises(InputError, match=r"color_by is 'k_max'; expected 'gaussian', 'mean' or 'total'"):
        save_ply(cloud, tmp_path / "cloud.ply", color_by="k_max")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"cloud\.obj does not end with \.ply, and PLY is what is written: rename it"):
        save_ply(cloud, tmp_path / "cloud.obj")
    with pytest.raises(InputError, match=r"the folder of .* does not exist: create it first"):
        save_ply(cloud, tmp_path / "nowhere" / "cloud.ply")


def test_export_knows_nothing_of_shapes_adapters_or_reports_at_run_time() -> None:
    """So that the methods of `Shape` may import it."""
    for path in Path(topokit.export.__file__).parent.glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        typed = [node for node in tree.body if isinstance(node, ast.If)]
        names = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module}
        names -= {n.module for block in typed for n in ast.walk(block) if isinstance(n, ast.ImportFrom) and n.module}
        rooms = {name.split(".")[1] for name in names if name.startswith("topokit.")}
        assert rooms <= {"errors", "inputs", "core", "export"}, path
