"""Volumes counted block by block: all numbers equal those of the whole, of scikit-image and of gudhi, however cut."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from skimage.measure import euler_number, label

from topokit.core.blocks.cubes import cube_tables
from topokit.core.blocks.division import Division, Triple
from topokit.core.blocks.part import Part, count_part, join_parts
from topokit.core.blocks.whole import CountedVolume, counted_volume
from topokit.core.grid.grid import Grid

Bools = NDArray[np.bool_]
Cuts = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]

connectivities = st.sampled_from((6, 26))
volumes = arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=7))


@st.composite
def divided_volumes(draw: st.DrawFn) -> tuple[Bools, Division]:
    """A volume with background all round, and blocks of it."""
    padded = np.pad(draw(volumes), 1)
    x, y, z = ((0, *sorted(draw(st.sets(st.integers(1, n - 1)))), n) for n in padded.shape)
    return padded, Division((x, y, z))


def part_of(padded: Bools, connectivity: int, division: Division) -> Part:
    is_six = padded if connectivity == 6 else ~padded
    shape = division.shape
    return division.reduce(
        lambda box: count_part(is_six[tuple(slice(*side) for side in box)], tuple(side[0] for side in box), shape),
        join_parts,
    )


def counted(padded: Bools, connectivity: int, division: Division, grid: Grid | None = None) -> CountedVolume:
    x, y, z = (n - 2 for n in padded.shape)
    return counted_volume(part_of(padded, connectivity, division), connectivity, grid or Grid((x, y, z)))


def undivided(padded: Bools, connectivity: int) -> CountedVolume:
    x, y, z = ((0, n) for n in padded.shape)
    return counted(padded, connectivity, Division((x, y, z)))


def every(side: int, shape: Triple) -> Division:
    x, y, z = ((*range(0, n, side), n) for n in shape)
    return Division((x, y, z))


@given(divided_volumes(), connectivities)
@settings(max_examples=60, deadline=None)
def test_blocks_give_the_numbers_of_the_whole(divided: tuple[Bools, Division], connectivity: int) -> None:
    padded, division = divided
    found, expected = counted(padded, connectivity, division), undivided(padded, connectivity)
    assert found.surfaces == expected.surfaces  # χ, genus, box, area, nesting and volume of each, in the same order
    assert (found.euler, found.dual_euler, found.n_inside) == (expected.euler, expected.dual_euler, expected.n_inside)
    assert found.touched == expected.touched
    assert found.solid_betti.tolist() == expected.solid_betti.tolist()


@given(divided_volumes(), connectivities)
@settings(max_examples=50, deadline=None)
def test_blocks_agree_with_scikit_image(divided: tuple[Bools, Division], connectivity: int) -> None:
    padded, division = divided
    found = counted(padded, connectivity, division)
    ways = (1, 3) if connectivity == 6 else (3, 1)  # its names for 6 and 26
    components, regions = (
        label(part, connectivity=way).max() for part, way in zip((padded, ~padded), ways, strict=True)
    )
    tunnels = components + regions - 1 - euler_number(padded, ways[0])
    assert found.surfaces.solid_betti == (components, tunnels, regions - 1)


@given(divided_volumes(), connectivities)
@settings(max_examples=50, deadline=None)
def test_blocks_agree_with_gudhi(divided: tuple[Bools, Division], connectivity: int) -> None:
    gudhi = pytest.importorskip("gudhi")
    padded, division = divided
    values = {"vertices" if connectivity == 6 else "top_dimensional_cells": np.where(padded, 0.0, 1.0)}
    cubical = gudhi.CubicalComplex(**values)
    cubical.compute_persistence()
    betti = [*cubical.persistent_betti_numbers(0.5, 0.5), 0, 0, 0][:3]
    found = counted(padded, connectivity, division)
    assert found.surfaces.solid_betti == tuple(betti)


def test_a_spiral_through_many_blocks_is_one_component() -> None:
    """A path that winds around a box in ever smaller circles, with the background as its mirror image."""
    side = 33
    plane = np.zeros((side, side), bool)
    x = y = 1
    length, direction = side - 3, 0
    plane[1, 1] = True
    while length > 0:
        for _ in range(2 if length < side - 3 else 3):
            dx, dy = ((0, 1), (1, 0), (0, -1), (-1, 0))[direction % 4]
            for _ in range(length):
                x, y = x + dx, y + dy
                plane[x, y] = True
            direction += 1
        length -= 2
    padded = np.zeros((side, side, 5), bool)
    padded[:, :, 2] = plane
    for connectivity, block in product((6, 26), (2, 7)):
        found = counted(padded, connectivity, every(block, padded.shape))
        assert found.surfaces == undivided(padded, connectivity).surfaces
        assert found.surfaces.solid_betti == (1, 0, 0)


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("block", [2, 5, 8])
def test_cavities_and_what_floats_in_them_cut_by_block_faces(connectivity: int, block: int) -> None:
    padded = np.zeros((22, 20, 18), bool)
    padded[1:-1, 1:-1, 1:-1] = True
    padded[4:-4, 4:-4, 4:-4] = False  # a cavity through all blocks
    padded[7:-7, 7:-7, 7:-7] = True  # with a solid in it
    padded[10:12, 9:11, 8:10] = False  # with a cavity in it
    found = counted(padded, connectivity, every(block, padded.shape))
    assert found.surfaces == undivided(padded, connectivity).surfaces
    assert found.surfaces.solid_betti == (2, 0, 2)
    assert [surface.depth for surface in found.surfaces] == [0, 1, 2, 3]
    assert found.surfaces[3].volume == 8


@pytest.mark.parametrize("connectivity", [6, 26])
def test_noise_keeps_every_number(connectivity: int) -> None:
    padded = np.pad(np.random.default_rng(0).random((25, 31, 28)) < 0.4, 1)
    assert counted(padded, connectivity, every(9, padded.shape)).surfaces == undivided(padded, connectivity).surfaces


def test_a_part_does_not_depend_on_the_order_of_joining() -> None:
    padded = np.pad(np.random.default_rng(1).random((9, 9, 9)) < 0.5, 1)
    once, again = (part_of(padded, 26, every(side, padded.shape)) for side in (3, 5))
    assert sorted(map(tuple, once.nodes)) == sorted(map(tuple, again.nodes))
    assert (once.dual, once.walls[:, 2:].sum(0).tolist()) == (again.dual, again.walls[:, 2:].sum(0).tolist())


@given(st.lists(st.lists(st.integers(1, 40), min_size=1, max_size=9), min_size=3, max_size=3), st.integers(1, 20_000))
def test_blocks_are_whole_chunks_and_bounded(chunks: list[list[int]], most: int) -> None:
    division = Division.of(chunks, most)
    largest = [max(lengths) for lengths in chunks]
    for cuts, lengths in zip(division.cuts, chunks, strict=True):
        assert set(cuts) <= {0, *np.cumsum(lengths).tolist()}
        assert cuts[-1] == sum(lengths)
        assert all(start < stop for start, stop in pairwise(cuts))
    sides = [max(stop - start for start, stop in pairwise(cuts)) for cuts in division.cuts]
    assert np.prod(sides) <= max(most, np.prod(largest))


def test_the_table_of_cubes_adds_up() -> None:
    tables = cube_tables()
    for code in range(256):
        pieces = [piece for piece in tables.pieces[code].tolist() if piece]
        assert sum(pieces) == code
        assert tables.weights[pieces].sum(0).tolist() == tables.weights[code].tolist()
        assert tables.dual[code] == tables.weights[255 - code, 0]
        if not pieces or code == 255:
            assert not tables.weights[code].any()
