"""Pictures: what is nearest is drawn, colors are the curvature's, lines are seen, and nothing needs a display."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.errors import InputError
from topokit.export.picture import MARK_COLORS, colors_of, picture_of
from topokit.export.scene import Mark, scene_of, simplified
from topokit.export.surfels import Surfels, render
from topokit.testing import icosphere, sphere_samples, torus_mesh


def test_what_is_nearest_to_the_eye_is_drawn() -> None:
    ball = np.random.default_rng(0).normal(size=(20_000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    red_above = np.where(ball[:, 2:] > 0, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    seen = render(Surfels(ball, ball, red_above), (0.0, 0.01, 1.0), 40).astype(int)
    assert (seen[[0, 0, -1, -1], [0, -1, 0, -1]] == 255).all()
    assert (seen[10:30, 10:30, 0] > seen[10:30, 10:30, 2] + 60).all()


def test_the_silhouette_of_a_mesh_is_filled_without_gaps() -> None:
    shape = tk.from_mesh(icosphere(4))
    picture = picture_of(scene_of(shape, max_faces=5_000, max_points=100), 90)
    drawn = (picture < 250).any(axis=2)
    for row in drawn[drawn.any(axis=1)]:  # a convex shape: every row is one run
        columns = np.flatnonzero(row)
        assert len(columns) == columns[-1] - columns[0] + 1


def test_a_torus_is_red_outside_and_blue_inside() -> None:
    vertices, faces = torus_mesh(60, 30)
    scene = scene_of(tk.from_mesh((vertices, faces)), max_faces=20_000, max_points=100)
    radius = np.hypot(scene.positions[:, 0], scene.positions[:, 1])
    red, _, blue = colors_of(scene).T.astype(int)
    order = radius.argsort()
    tenth = len(order) // 10
    assert (blue - red)[order[:tenth]].min() > 30
    assert (red - blue)[order[-tenth:]].min() > 30


def test_points_and_volumes_are_drawn() -> None:
    axis = torch.linspace(-1, 1, 24)
    ball = 0.7 - torch.cartesian_prod(axis, axis, axis).norm(dim=1).reshape(24, 24, 24)
    for shape in (tk.from_points(sphere_samples(2_000).points), tk.from_voxels(ball, level=0.0)):
        picture = picture_of(scene_of(shape, max_faces=5_000, max_points=1_000), 60)
        share = (picture < 250).any(axis=2).mean()
        assert 0.4 < share < 0.7, "a disc of 84 % of the side covers 55 % of the picture"


def test_a_volume_is_drawn_where_it_is() -> None:
    volume = torch.zeros(20, 30, 40)
    volume[5:15, 10:20, 20:30] = 1
    scene = scene_of(tk.from_voxels(volume, spacing=(1, 2, 3), level=0.5), max_faces=10_000, max_points=100)
    np.testing.assert_allclose(scene.positions.min(axis=0), (4.5, 19, 58.5), atol=0.1)
    np.testing.assert_allclose(scene.positions.max(axis=0), (14.5, 39, 88.5), atol=0.1)
    assert scene.faces is not None
    a, b, c = np.moveaxis(scene.positions[scene.faces], 1, 0)
    volume_inside = (a * np.cross(b, c)).sum() / 6
    assert 10 * 20 * 30 * 0.9 < volume_inside < 10 * 20 * 30, "triangles face outward"


def test_a_line_is_drawn_in_its_color() -> None:
    shape = tk.from_points(sphere_samples(2_000).points)
    angle = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    loop = np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=1) * 1.02
    line = Mark("handle", "handle 1", loop, "loop")
    assert line.length == pytest.approx(2 * np.pi * 1.02, rel=0.01)
    np.testing.assert_allclose(line.center, 0, atol=1e-9)
    without, marked = (
        picture_of(scene_of(shape, lines, max_faces=100, max_points=2_000), 120).astype(int) for lines in ((), (line,))
    )
    assert (np.abs(without - marked).sum(axis=2) > 60).sum() > 40
    red, green, blue = MARK_COLORS["handle"]
    assert ((marked[..., 0] > 1.5 * marked[..., 1]) & (marked[..., 1] > marked[..., 2])).sum() > 40
    assert red > 1.5 * green > blue


def test_a_large_mesh_is_simplified_and_says_so() -> None:
    vertices, faces = torus_mesh(120, 60)
    positions, triangles, note = simplified(vertices, faces, 2_000)
    assert 1_500 < len(triangles) <= 2_000
    assert note is not None
    assert "from 14400 to" in note
    distance = np.hypot(np.hypot(positions[:, 0], positions[:, 1]) - 1.0, positions[:, 2])
    assert np.ptp(distance) < 0.05, "it is still a torus"
    assert simplified(vertices, faces, 20_000)[2] is None


def test_batched_samples_are_refused() -> None:
    shape = tk.from_points(torch.stack([sphere_samples(200).points] * 2))
    with pytest.raises(InputError, match="one shape is drawn at a time"):
        scene_of(shape, max_faces=100, max_points=100)
