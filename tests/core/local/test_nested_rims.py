"""Rims within each other in a plane."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Floats
from topokit.core.local.nested_rims import has_open_ring

SPACING = 0.05


def circle(radius: float, height: float = 0.0) -> Floats:
    angle = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle), np.full(100, height)), axis=1)


def lattice(height: float) -> Floats:
    """A plane of samples."""
    ticks = np.arange(-1, 1, SPACING)
    x, y = np.meshgrid(ticks, ticks)
    return np.stack((x.ravel(), y.ravel(), np.full(x.size, height)), axis=1)


RING = [circle(1.0), circle(0.3)]


def test_a_missing_underside_with_a_hole_is_a_ring() -> None:
    assert has_open_ring(RING, lattice(height=0.5), SPACING)
    assert has_open_ring(RING[::-1], lattice(height=0.5), SPACING)


def test_a_flat_sheet_with_a_hole_is_none() -> None:
    assert not has_open_ring(RING, lattice(height=0.0), SPACING)


def test_rims_beside_or_above_each_other_are_none() -> None:
    far = lattice(height=0.5)
    assert not has_open_ring([circle(1.0), circle(0.3) + np.array([2.0, 0, 0])], far, SPACING)
    assert not has_open_ring([circle(1.0), circle(0.3, height=0.5)], far, SPACING)
    assert not has_open_ring([circle(1.0)], far, SPACING)
    assert not has_open_ring([circle(1.0), circle(0.9)], far, SPACING)  # the ring is too narrow to be seen
