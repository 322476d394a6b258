"""`Shape.handles` and `fill_boundaries` as users meet them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from planted_noise import planted

import topokit as tk
from topokit.testing import genus_mesh, icosphere, torus_mesh, torus_samples
from topokit.testing.meshes import Mesh, joined


def box_mesh(size: float) -> Mesh:
    box = trimesh.creation.box((2 * size,) * 3).subdivide().subdivide().subdivide()
    return np.asarray(box.vertices), np.asarray(box.faces)


@pytest.mark.parametrize(("major", "minor"), [(1, 0.4), (1, 0.2), (2, 0.9), (1, 0.7)])
def test_a_torus_has_a_meridian_and_its_inner_equator(major: float, minor: float) -> None:
    [handle] = tk.from_mesh(*torus_mesh(90, 45, major, minor)).handles()
    assert handle.handle_length == pytest.approx(2 * math.pi * minor, rel=0.01)
    assert handle.tunnel_length == pytest.approx(2 * math.pi * (major - minor), rel=0.01)
    for loop, length in ((handle.handle_loop, handle.handle_length), (handle.tunnel_loop, handle.tunnel_length)):
        assert length == pytest.approx(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum())
    assert handle.size == min(handle.handle_length, handle.tunnel_length)
    assert np.allclose(handle.tunnel_loop[:, 2], 0, atol=0.1 * minor)
    low, high = np.array(handle.bounds)
    assert (low <= np.concatenate((handle.handle_loop, handle.tunnel_loop)).min(axis=0)).all()
    assert (high >= np.concatenate((handle.handle_loop, handle.tunnel_loop)).max(axis=0)).all()


@pytest.mark.parametrize("genus", [2, 4])
def test_a_bar_with_holes(genus: int) -> None:
    """Its rings have a tube of radius 0.35 around circles of radius 1, and are joined where they meet."""
    handles = tk.from_mesh(*genus_mesh(genus)).handles()
    assert len(handles) == genus
    assert [handle.size for handle in handles] == sorted(handle.size for handle in handles)
    lengths = np.array([[handle.handle_length, handle.tunnel_length] for handle in handles])
    assert (np.abs(lengths[:, 0] / (2 * math.pi * 0.35) - 1) < 0.05).all()
    assert (lengths[:, 1] < 1.05 * 2 * math.pi * 0.65).all()
    assert (lengths[:, 1] > 0.93 * 2 * math.pi * 0.65).all(), "shorter where the rings melt together"
    holes = {round(float(np.ptp(handle.tunnel_loop[:, 0]) / 2 + handle.tunnel_loop[:, 0].min())) for handle in handles}
    assert len(holes) == genus, "one tunnel loop around each hole"


def test_a_ring_shaped_cavity_and_a_drilled_box_have_their_kinds_exchanged() -> None:
    ring = torus_mesh(60, 30, 1, 0.3)
    [cavity] = tk.from_mesh(*joined(box_mesh(2), ring)).handles()
    assert cavity.tunnel_length == pytest.approx(2 * math.pi * 0.3, rel=0.01)
    assert cavity.handle_length == pytest.approx(2 * math.pi * 0.7, rel=0.01)
    assert cavity.component == 1
    drilled = trimesh.creation.annulus(0.2, 2, 1, sections=40).subdivide().subdivide()
    [hole] = tk.from_mesh(drilled).handles()
    assert hole.tunnel_length == pytest.approx(2 * math.pi * 0.2, rel=0.02)
    assert hole.handle_length == pytest.approx(2 * (1.8 + 1), rel=0.02)


def test_loops_of_several_components_know_theirs() -> None:
    vertices, faces = torus_mesh(30, 15, 1, 0.3)
    shape = tk.from_mesh(*joined((vertices, faces), (vertices * 0.5 + 4, faces), icosphere(2, 0.1)))
    small, large = shape.handles()
    report = shape.report()
    assert report.per_component is not None
    for handle in (small, large):
        low, high = report.per_component[handle.component].bounds
        assert (handle.tunnel_loop >= np.array(low) - 1e-9).all()
        assert (handle.tunnel_loop <= np.array(high) + 1e-9).all()
    assert small.handle_length == pytest.approx(large.handle_length / 2, rel=1e-6)


def test_cut_and_fill_give_a_sphere_and_leave_the_rest_alone() -> None:
    vertices, faces = torus_mesh(40, 20)
    shape = tk.from_mesh(vertices, faces)
    [handle] = shape.handles()
    for result in (handle.cut(), handle.fill()):
        report = result.report()
        assert (report.euler, report.verdict) == (2, "certain")
        corners = result.to_trimesh().vertices
        moved = (corners[: len(vertices)] != vertices).any(axis=1)
        assert 0 < moved.sum() <= 60
        assert len(np.unique(np.float32(corners), axis=0)) == len(corners), "an STL file of it keeps the two caps apart"
    assert handle.cut().to_trimesh().volume < shape.surface().volume
    assert "handle_length=" in repr(handle)


def test_without_handles_there_are_none() -> None:
    assert tk.from_mesh(*icosphere(2)).handles() == ()


def test_fill_boundaries_closes_a_mesh() -> None:
    vertices, faces = torus_mesh(30, 15)
    is_open = faces[np.linalg.norm(vertices[faces].mean(axis=1) - vertices[5], axis=1) > 0.25]
    shape = tk.from_mesh(vertices, is_open)
    assert shape.report().boundary_loops == 1
    report = shape.fill_boundaries().report()
    assert (report.euler, report.verdict) == (0, "certain")
    with pytest.raises(tk.InputError, match="closed"):
        shape.handles()


def test_shapes_without_a_mesh_have_no_boundary_to_fill() -> None:
    with pytest.raises(tk.InputError, match="mesh"):
        tk.from_points(np.random.default_rng(0).normal(size=(100, 3))).fill_boundaries()


def test_points_and_functions_have_handles_where_they_have_a_surface() -> None:
    samples = torus_samples(3_000, major=1.0, minor=0.4)
    ring = tk.from_sdf(lambda p: torch.hypot(p[:, :2].norm(dim=1) - 0.6, p[:, 2]) - 0.25, resolution=128)
    for shape, minor, hole in ((tk.from_points(samples.points, samples.normals), 0.4, 0.6), (ring, 0.25, 0.35)):
        [handle] = shape.handles()
        assert handle.handle_length == pytest.approx(2 * math.pi * minor, rel=0.03)
        assert handle.tunnel_length == pytest.approx(2 * math.pi * hole, rel=0.03)
        assert handle.fill().genus() == 0


def test_noise_on_a_real_mesh_is_removed_and_nothing_else(real_data: Path) -> None:
    vertices, faces = (part.numpy() for part in tk.load(real_data / "meshes" / "paper_Kitten.obj").mesh)
    noisy = tk.from_mesh(*planted((vertices.astype(float), faces), 10, np.random.default_rng(1)))
    assert noisy.genus() == 11
    handles = noisy.handles()
    sizes = [handle.size for handle in handles]
    assert sizes == sorted(sizes)
    assert 10 * sizes[9] < sizes[10]
    clean = noisy.simplify(below=sizes[9], components=False)
    report = clean.report()
    assert (report.genus, report.verdict) == (1, "certain")
    assert np.array_equal(clean.mesh[0].numpy()[: len(vertices)], vertices)
