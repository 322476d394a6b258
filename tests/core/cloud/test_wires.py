"""Wires: thin tubes are read as thickened graphs, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from tubes import cube_edges, linked_rings, torus_knot, tube

import topokit
from topokit.core.cloud.wires import read_wire, segment_narrowness
from topokit.testing import sphere_samples, torus_samples

WIRES = {
    "trefoil, 0.6 spacings": (torus_knot(2, 3), 0.02, 1500, 0, 1),
    "trefoil, 1.2 spacings": (torus_knot(2, 3), 0.04, 3000, 0, 1),
    "five strands, 1 spacing": (torus_knot(2, 5), 0.06, 1500, 0, 1),
    "cube's edges, 0.7 spacings": (cube_edges(), 0.012, 2500, -8, 1),
    "linked rings, 0.9 spacings": (linked_rings(), 0.035, 2000, 0, 2),
    "an arc": (torus_knot(2, 3)[:40], 0.03, 1200, 2, 1),
}


@pytest.mark.parametrize("name", WIRES)
def test_thin_tubes_are_read_as_thickened_graphs(name: str) -> None:
    segments, radius, n_points, euler, components = WIRES[name]
    points, outward = tube(segments, radius, n_points)
    found = read_wire(points)
    assert found is not None
    assert (found.euler, found.components, found.n_stray) == (euler, components, 0)
    assert found.largest > 2 * found.smallest
    assert (found.normals * outward).sum(1).mean() > 0.8


def test_stray_points_are_left_out() -> None:
    points, _ = tube(torus_knot(2, 3), 0.03, 2000)
    stray = np.array([[5.0, 5, 5], [-4, 3, 2], [0, 0, 3], [1e6, 0, 0]])
    found = read_wire(np.concatenate((points, stray)))
    assert found is not None
    assert (found.euler, found.components, found.n_stray) == (0, 1, 4)


def test_surfaces_are_not_wires() -> None:
    direction = sphere_samples(2500).points.numpy()
    square = np.random.default_rng(0).uniform(-1, 1, (3000, 3))
    clouds = {
        "sphere": direction,
        "torus": torus_samples(3000).points.numpy(),
        "shell": np.concatenate((direction, 0.9 * direction)),
        "thin plate": square * [1, 1, 1e-3],
        "two sheets": np.where(np.arange(3) == 2, 0.01 * np.sign(square), square),
        "ball": square[np.linalg.norm(square, axis=1) < 1],
        "thick tube": tube(torus_knot(2, 3), 0.15, 4000)[0],
        "few points": tube(torus_knot(2, 3), 0.02, 400)[0],
    }
    assert [name for name, points in clouds.items() if read_wire(points) is not None] == []


def test_a_wire_beside_a_solid_is_not_read() -> None:
    """The balls around a solid's surface hold a cavity, so this cloud is no thickened graph."""
    points, _ = tube(torus_knot(2, 3), 0.02, 3000)
    solid = 0.15 * sphere_samples(1200).points.numpy() + [3.0, 0, 0]
    both = np.concatenate((points, solid))
    assert min(segment_narrowness(both, cKDTree(both))) < 0.3
    assert read_wire(both) is None


def test_the_report_of_a_wire_says_over_which_radii_its_integer_stands() -> None:
    points, _ = tube(cube_edges(), 0.015, 2500)
    report = topokit.from_points(torch.from_numpy(points)).report()
    assert (report.euler, report.genus, report.components, report.closed) == (-8, 5, 1, True)
    assert report.verdict == "likely"
    assert any("for radii from" in reason for reason in report.reasons)
    assert report.evidence[-1].name == "union of balls"
    assert report.evidence[-1].integer == -8


def test_wires_as_near_as_their_gaps_leave_the_report_unsure() -> None:
    """Coils of a tight helix touch before the gaps along them close."""
    t = np.linspace(0, 1, 200)
    corners = np.stack((0.3 * np.cos(20 * np.pi * t), 0.3 * np.sin(20 * np.pi * t), t), 1)
    points, _ = tube(np.stack((corners[:-1], corners[1:]), 1), 0.012, 1500)
    assert topokit.from_points(torch.from_numpy(points)).report().verdict == "unsure"
