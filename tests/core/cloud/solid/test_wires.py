"""Wires: thin tubes are read as thickened graphs, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from tubes import cube_edges, linked_rings, torus_knot, tube

import topokit
from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.settings import WireSettings
from topokit.core.cloud.solid.wires import WireReading, read_wire, segment_narrowness
from topokit.core.cloud.witness import global_witness
from topokit.testing import sphere_samples, torus_samples

Floats = NDArray[np.float64]
WIRES = {
    "trefoil, 0.6 spacings": (torus_knot(2, 3), 0.02, 1500, 0, 1),
    "trefoil, 1.2 spacings": (torus_knot(2, 3), 0.04, 3000, 0, 1),
    "five strands, 1 spacing": (torus_knot(2, 5), 0.06, 1500, 0, 1),
    "cube's edges, 0.7 spacings": (cube_edges(), 0.012, 2500, -8, 1),
    "linked rings, 0.9 spacings": (linked_rings(), 0.035, 2000, 0, 2),
    "an arc": (torus_knot(2, 3)[:40], 0.03, 1200, 2, 1),
}


def read(points: Floats, settings: WireSettings | None = None) -> WireReading | None:
    found = read_wire(points, cKDTree(points), settings or WireSettings())
    return None if found is None else found[0]


@pytest.mark.parametrize("name", WIRES)
def test_thin_tubes_are_read_as_thickened_graphs(name: str) -> None:
    segments, radius, n_points, euler, components = WIRES[name]
    points, outward = tube(segments, radius, n_points)
    found = read(points)
    assert found is not None
    assert (found.euler, found.components, found.n_stray) == (euler, components, 0)
    assert found.largest > 2 * found.smallest
    assert (found.normals * outward).sum(1).mean() > 0.8


def test_stray_points_are_left_out() -> None:
    points, _ = tube(torus_knot(2, 3), 0.03, 2000)
    stray = np.array([[5.0, 5, 5], [-4, 3, 2], [0, 0, 3], [1e6, 0, 0]])
    found = read(np.concatenate((points, stray)))
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
    assert [name for name, points in clouds.items() if read(points) is not None] == []


def test_a_wire_beside_a_solid_is_not_read() -> None:
    """The balls around a solid's surface hold a cavity, so this cloud is no thickened graph."""
    points, _ = tube(torus_knot(2, 3), 0.02, 3000)
    solid = 0.15 * sphere_samples(1200).points.numpy() + [3.0, 0, 0]
    both = np.concatenate((points, solid))
    assert min(segment_narrowness(both, cKDTree(both), WireSettings())) < 0.3
    assert read(both) is None


def test_the_report_of_a_wire_says_over_which_radii_its_integer_stands() -> None:
    points, _ = tube(cube_edges(), 0.015, 2500)
    report = topokit.from_points(torch.from_numpy(points)).report()
    assert (report.euler, report.genus, report.components, report.closed) == (-8, 5, 1, True)
    assert report.verdict == "likely"
    assert any("χ = -8" in reason and "radii" in reason for reason in report.reasons)
    assert report.evidence[-1].name == "union of balls"
    assert report.evidence[-1].integer == -8


def test_wires_as_near_as_their_gaps_leave_the_report_unsure() -> None:
    """Coils of a tight helix touch before the gaps along them close."""
    t = np.linspace(0, 1, 200)
    corners = np.stack((0.3 * np.cos(20 * np.pi * t), 0.3 * np.sin(20 * np.pi * t), t), 1)
    points, _ = tube(np.stack((corners[:-1], corners[1:]), 1), 0.012, 1500)
    assert topokit.from_points(torch.from_numpy(points)).report().verdict == "unsure"


def test_a_cloud_of_wires_is_read_from_evenly_spread_samples() -> None:
    points, outward = tube(torus_knot(2, 3), 0.02, 3000)
    found = read_wire(points, cKDTree(points), WireSettings(samples=1500))
    assert found is not None
    reading, kept, owner = found
    assert (reading.euler, reading.components) == (0, 1)
    assert 1200 < len(kept) <= 1500
    assert owner.shape == (3000,)
    np.testing.assert_array_equal(owner[kept], np.arange(len(kept)))
    assert (reading.normals[owner] * outward).sum(1).mean() > 0.8


def thin_rings(count: int, n_points: int) -> Floats:
    """Random samples of rings of radius 1 and 0.02 in rows, far from each other; χ = 0."""
    draws, rings = np.random.default_rng(0), []
    for number in range(count):
        u, v = draws.uniform(0, 2 * np.pi, (2, n_points))
        ring = 1 + 0.02 * np.cos(v)
        row, column = divmod(number, 12)
        rings.append(np.stack((ring * np.cos(u) + 3 * column, ring * np.sin(u) + 3 * row, 0.02 * np.sin(v)), 1))
    return np.concatenate(rings)


def test_many_thin_parts_of_few_points_each_are_read() -> None:
    found = global_witness(torch.from_numpy(thin_rings(144, 100)))
    assert (found.euler, found.components, found.preparation) == (0, 144, "wire")
    assert found.wire is not None
    assert found.wire.n_stray < 100


@pytest.mark.parametrize("count", [FEWEST_POINTS - 1, FEWEST_POINTS])
def test_parts_of_fewer_points_than_bound_a_solid_are_left_out(count: int) -> None:
    wire, part = tube(torus_knot(2, 3), 0.03, 2000)[0], 0.01 * sphere_samples(count).points.numpy() + 9.0
    reading = read(np.concatenate((wire, part)))
    assert reading is not None
    n_stray = count if count < FEWEST_POINTS else 0
    assert (reading.components, reading.n_stray) == (1 if n_stray else 2, n_stray)


def test_nothing_is_read_if_all_parts_are_left_out() -> None:
    row = np.concatenate([np.stack((np.linspace(0, 1, 30), np.full(30, 9.0 * k), np.zeros(30)), 1) for k in range(20)])
    assert read(row + 1e-3 * np.random.default_rng(0).normal(size=row.shape)) is None


def linked_circles(n_points: int) -> Floats:
    """Even samples of two circles through each other's middle; their Delaunay tetrahedra are as many as N²."""
    angle = np.linspace(0, 2 * np.pi, n_points // 2, endpoint=False)
    x, y, zero = np.cos(angle), np.sin(angle), 0 * angle
    return np.concatenate((np.stack((x, y, zero), 1), np.stack((1 + x, zero, y), 1)))


@pytest.mark.parametrize("n_points", [1000, 20_000])
def test_wires_need_no_cuts_and_curves_few_tetrahedra(n_points: int) -> None:
    """Of 8 000 points on two linked circles there are ten million tetrahedra."""
    found = global_witness(torch.from_numpy(linked_circles(n_points)))
    assert found.n_used <= 1000
    assert (found.euler, found.components, found.cavities) == (0, 2, 0)
    assert found.votes == ()
    assert found.surface is None
    assert found.lids == ()
    assert found.wire is not None
    assert found.wire.share > 0.9
