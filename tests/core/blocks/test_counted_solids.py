"""Solids on grids and their closed surfaces: Betti numbers, nesting, boxes and volumes, against brute force."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import torch
from analytic_fields import ball, grid, torus
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes, generate_binary_structure, label

from topokit.core.blocks.whole import CountedVolume, count_solid
from topokit.core.components import CountedComponents, SurfaceComponent
from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import Grid, occupied_box

CONNECTIVITIES = (6, 26)
Bools = NDArray[np.bool_]

connectivities = st.sampled_from(CONNECTIVITIES)
volumes = arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=6))


def components_of(mask: Bools, connectivity: int) -> list[Bools]:
    labels, count = label(mask, np.ones((3, 3, 3)) if connectivity == 26 else None)
    return [labels == number for number in range(1, count + 1)]


def counted(mask: Bools, connectivity: int, grid: Grid | None = None) -> CountedVolume:
    x, y, z = mask.shape
    return count_solid(torch.from_numpy(mask), lambda inside: inside, connectivity, grid or Grid((x, y, z)))


def surfaces_of(mask: Bools, connectivity: int) -> tuple[SurfaceComponent, ...]:
    return tuple(counted(mask, connectivity).surfaces)


def encloses(outer: Bools, inner: Bools, connectivity: int) -> bool:
    """Whether `inner` lies in a cavity of `outer`: filling the holes of `outer` covers it."""
    structure = generate_binary_structure(3, 1 if connectivity == 26 else 3)
    filled = binary_fill_holes(np.pad(outer, 1), structure)[1:-1, 1:-1, 1:-1]
    return bool(filled[inner].all())


def box_of(mask: Bools) -> tuple[tuple[float, ...], tuple[float, ...]]:
    places = np.argwhere(mask)
    return tuple(places.min(0) - 0.5), tuple(places.max(0) + 0.5)


@given(volumes, connectivities)
@settings(max_examples=100, deadline=None)
def test_betti_numbers_of_each_component(mask: Bools, connectivity: int) -> None:
    parts = sorted(components_of(mask, connectivity), key=lambda part: -part.sum())
    expected = [betti_numbers(part, 0, connectivity).tolist() for part in parts]
    found = counted(mask, connectivity)
    assert sorted(found.solid_betti.tolist()) == sorted(expected)  # equal components may be exchanged
    assert found.solid_betti.sum(0).tolist() == betti_numbers(mask, 0, connectivity).tolist()
    assert found.n_inside == mask.sum()
    assert found.touched == tuple((mask.take(0, axis).any(), mask.take(-1, axis).any()) for axis in range(3))


@given(volumes, connectivities)
@settings(max_examples=100, deadline=None)
def test_outer_walls_are_nested_as_their_components(mask: Bools, connectivity: int) -> None:
    parts = components_of(mask, connectivity)
    expected = Counter(
        (box_of(part), part.sum(), 2 * sum(encloses(other, part, connectivity) for other in parts if other is not part))
        for part in parts
    )
    surfaces = surfaces_of(mask, connectivity)
    assert Counter((wall.bounds, wall.volume, wall.depth) for wall in surfaces if not wall.depth % 2) == expected


@given(volumes, connectivities)
@settings(max_examples=100, deadline=None)
def test_surfaces_add_up(mask: Bools, connectivity: int) -> None:
    surfaces = surfaces_of(mask, connectivity)
    b0, b1, b2 = betti_numbers(mask, 0, connectivity).tolist()
    assert sum(wall.euler for wall in surfaces) == surface_euler(mask, 0, connectivity)
    assert counted(mask, connectivity).euler == surface_euler(mask, 0, connectivity)
    assert counted(mask, connectivity).dual_euler == surface_euler(mask, 0, 32 - connectivity)
    assert (len(surfaces), sum(wall.depth % 2 for wall in surfaces)) == (b0 + b2, b2)
    assert sum(wall.genus for wall in surfaces) == b1
    assert all(wall.genus >= 0 for wall in surfaces)
    assert sum(wall.area_share for wall in surfaces) == pytest.approx(float(mask.any()))
    for wall in surfaces:
        above = surfaces[wall.inside] if wall.inside is not None else None
        assert wall.depth == (0 if above is None else above.depth + 1)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_nested_shells_with_two_pearls(connectivity: int) -> None:
    p = grid(48)
    shell = lambda outer, inner: torch.minimum(ball(p, outer), -ball(p, inner))  # noqa: E731
    pearls = torch.maximum(ball(p, 0.1, (0, 0, -0.15)), ball(p, 0.1, (0, 0, 0.15)))
    solid = torch.stack((shell(0.85, 0.7), shell(0.5, 0.35), pearls)).amax(0) > 0
    surfaces = surfaces_of(solid.numpy(), connectivity)
    assert [(wall.euler, wall.depth, wall.inside) for wall in surfaces] == [
        (2, 0, None),
        (2, 1, 0),
        (2, 2, 1),
        (2, 3, 2),
        (2, 4, 3),
        (2, 4, 3),
    ]
    assert counted(solid.numpy(), connectivity).solid_betti.tolist() == [[1, 0, 1], [1, 0, 1], [1, 0, 0], [1, 0, 0]]


def test_linked_rings_are_not_nested() -> None:
    p = grid(40)
    rings = torch.maximum(torus(p, 0.45, 0.12, (-0.22, 0, 0)), torus(p.roll(1, -1), 0.45, 0.12, (0, 0.22, 0)))
    assert counted((rings > 0).numpy(), 26).solid_betti.tolist() == [[1, 1, 0], [1, 1, 0]]
    assert [(wall.euler, wall.inside, wall.depth) for wall in surfaces_of((rings > 0).numpy(), 26)] == [
        (0, None, 0)
    ] * 2


def test_boxes_and_areas_follow_the_grid() -> None:
    mask = torch.zeros(6, 7, 8, dtype=torch.bool)
    mask[1:4, 2:3, 5:7] = True
    assert occupied_box(mask) == [(1, 4), (2, 3), (5, 7)]
    (wall,) = counted(mask.numpy(), 6, Grid((6, 7, 8), (1.0, 2.0, 0.5), (10.0, 0.0, -1.0))).surfaces
    assert wall.bounds == ((10.5, 3.0, 1.25), (13.5, 5.0, 2.25))
    mask[5, 2, 5] = True  # one voxel: 2 + 1 + 4 of area beside 2·(3·2·1) for y, 2·(2·0.5·2) for x, 2·(3·2) for z
    large, small = counted(mask.numpy(), 6, Grid((6, 7, 8), (1.0, 2.0, 0.5))).surfaces
    whole = 2 * (3 * 1.0) + 2 * (2 * 1.0) + 2 * (3 * 2.0)
    one = 2 * (1.0 + 0.5 + 2.0)
    assert (large.area_share, small.area_share) == pytest.approx((whole / (whole + one), one / (whole + one)))


def test_nothing_has_no_surface() -> None:
    empty = counted(np.zeros((3, 4, 5), dtype=bool), 26)
    assert empty.surfaces == CountedComponents.none()
    assert empty.solid_betti.shape == (0, 3)
