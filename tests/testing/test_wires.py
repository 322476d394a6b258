"""Frames and knots have the topology that their docstrings say."""

from __future__ import annotations

import pytest

import topokit as tk
from topokit.testing import deltoidal_icositetrahedron, edge_tubes, torus_knot, triakis_tetrahedron


@pytest.mark.parametrize(
    ("frame", "n_vertices", "n_edges"),
    [(triakis_tetrahedron(), 8, 18), pytest.param(deltoidal_icositetrahedron(), 26, 48, marks=pytest.mark.long)],
)
def test_tubes_along_edges(frame: tuple, n_vertices: int, n_edges: int) -> None:
    assert (len(frame[0]), len(frame[1])) == (n_vertices, n_edges)
    report = tk.from_mesh(*edge_tubes(frame)).report()
    assert (report.euler, report.components, report.verdict) == (2 * (n_vertices - n_edges), 1, "certain")


def test_knots_are_tori() -> None:
    for turns, winds in ((2, 3), (5, 2)):
        report = tk.from_mesh(*torus_knot(turns, winds, radius=0.1)).report()
        assert (report.genus, report.components, report.verdict) == (1, 1, "certain")


def test_links_and_thin_tubes_are_refused() -> None:
    with pytest.raises(tk.InputError, match="common divisor"):
        torus_knot(2, 4)
    with pytest.raises(tk.InputError, match="too thin"):
        edge_tubes(triakis_tetrahedron(), radius=0.01)
