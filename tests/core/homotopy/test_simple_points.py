"""Simple points against Betti numbers that SciPy and scikit-image count in the 3 x 3 x 3 neighborhood."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from scipy.ndimage import generate_binary_structure, label
from skimage.measure import euler_number

from topokit.core.grid.betti import betti_numbers
from topokit.core.homotopy.simple_points import OFFSETS, PaddedSolid, count_touching, is_simple
from topokit.errors import InputError

FACES, EDGES, CORNERS = (generate_binary_structure(3, order) for order in (1, 2, 3))
MIDDLE = (1, 1, 1)


def random_cubes(count: int = 1500) -> np.ndarray:
    """(count, 3, 3, 3) neighborhoods of all densities."""
    draw = np.random.default_rng(3)
    return draw.random((count, 3, 3, 3)) < draw.random((count, 1, 1, 1))


def codes_of(cubes: np.ndarray) -> np.ndarray:
    return (cubes.reshape(-1, 27).astype(np.int64) << np.arange(27)).sum(1).astype(np.int32)


def components_touching_the_middle(cube: np.ndarray, connectivity: int) -> int:
    """The topological numbers of Bertrand and Malandain, by their definition."""
    around = cube.copy()
    around[MIDDLE] = False
    if connectivity == 26:
        return label(around, CORNERS)[1]
    labels, _ = label(around & EDGES, FACES)
    return len(set(labels[FACES & (labels > 0)].tolist()))


def betti_26(cube: np.ndarray) -> tuple[int, int, int]:
    components = label(cube, CORNERS)[1]
    cavities = label(~np.pad(cube, 1), FACES)[1] - 1
    return components, components + cavities - euler_number(cube, 3), cavities


def flipping_changes_nothing(cube: np.ndarray, connectivity: int) -> bool:
    """An equivalent definition of simple: flipping the middle voxel keeps the Betti numbers of the neighborhood.

    For connectivity 6 they are those of the background, which is 26-connected.
    """
    one = cube.copy() if connectivity == 26 else ~cube
    other = one.copy()
    other[MIDDLE] ^= True
    return betti_26(one) == betti_26(other)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_touching_components_are_those_of_the_definition(connectivity: int) -> None:
    cubes = random_cubes()
    solid, background = count_touching(codes_of(cubes), connectivity)
    expected = [components_touching_the_middle(cube, connectivity) for cube in cubes]
    assert solid.tolist() == np.minimum(expected, 2).tolist()
    expected = [components_touching_the_middle(~cube, 32 - connectivity) for cube in cubes]
    assert background.tolist() == np.minimum(expected, 2).tolist()
    assert {0, 1, 2} == set(solid.tolist()) == set(background.tolist())


@pytest.mark.parametrize("connectivity", [6, 26])
def test_simple_is_what_keeps_components_tunnels_and_cavities(connectivity: int) -> None:
    cubes = random_cubes()
    simple = is_simple(codes_of(cubes), connectivity)
    assert simple.tolist() == [flipping_changes_nothing(cube, connectivity) for cube in cubes]
    assert 100 < simple.sum() < len(cubes) - 100


def test_none_means_both_and_the_middle_voxel_is_ignored() -> None:
    cubes = random_cubes()
    codes = codes_of(cubes)
    simple = {one: is_simple(codes, one) for one in (6, 26, None)}
    assert (simple[None] == (simple[6] & simple[26])).all()
    assert (simple[6] != simple[26]).any()
    cubes[(slice(None), *MIDDLE)] ^= True
    for one, expected in simple.items():
        assert (is_simple(codes_of(cubes), one) == expected).all()


def test_48_symmetries_and_exchange_of_solid_and_background() -> None:
    cubes = random_cubes(400)
    for connectivity in (6, 26):
        simple = is_simple(codes_of(cubes), connectivity)
        for axes, signs in product(permutations((1, 2, 3)), product((1, -1), repeat=3)):
            turned = cubes.transpose(0, *axes)[:, :: signs[0], :: signs[1], :: signs[2]]
            assert (is_simple(codes_of(turned), connectivity) == simple).all()
        assert (is_simple(codes_of(~cubes), 32 - connectivity) == simple).all()


@pytest.mark.parametrize("shape", [(4, 5, 3), (1, 6, 4), (1, 1, 1)])
def test_neighborhoods_at_the_border_see_background_outside(shape: tuple[int, int, int]) -> None:
    solid = np.random.default_rng(5).random(shape) < 0.6
    padded = PaddedSolid(solid)
    at = padded.indices(np.ones(shape, dtype=bool))
    cubes = np.lib.stride_tricks.sliding_window_view(np.pad(solid, 1), (3, 3, 3)).reshape(-1, 3, 3, 3)
    assert (padded.codes(at) == codes_of(cubes)).all()
    for through_faces, near in ((True, FACES), (False, CORNERS)):
        on_surface = padded.on_surface(at, through_faces)
        assert (on_surface == [(cube != cube[MIDDLE])[near].any() for cube in cubes]).all()
        assert on_surface[is_simple(padded.codes(at), None if through_faces else 26)].all()
    assert (padded.solid() == solid).all()


@pytest.mark.parametrize("connectivity", [6, 26])
def test_flipping_a_simple_voxel_of_a_grid_keeps_its_betti_numbers(connectivity: int) -> None:
    solid = np.random.default_rng(1).random((4, 4, 4)) < 0.5
    before = betti_numbers(solid, connectivity=connectivity)
    padded = PaddedSolid(solid)
    voxels = np.argwhere(np.ones(solid.shape, dtype=bool))
    simple = is_simple(padded.codes(padded.indices(np.ones(solid.shape, dtype=bool))), connectivity)
    assert 5 < simple.sum() < solid.size - 5
    for voxel in voxels[simple]:
        solid[tuple(voxel)] ^= True
        assert betti_numbers(solid, connectivity=connectivity).equal(before), voxel
        solid[tuple(voxel)] ^= True


def test_voxels_of_one_parity_are_never_neighbors() -> None:
    padded = PaddedSolid(np.zeros((5, 4, 6), dtype=bool))
    parity = padded.parity(padded.indices(np.ones((5, 4, 6), dtype=bool))).reshape(5, 4, 6)
    assert set(parity.ravel().tolist()) == set(range(8))
    for x, y, z in OFFSETS[14:]:
        ahead = parity[x:, max(y, 0) : 4 + min(y, 0), max(z, 0) : 6 + min(z, 0)]
        behind = parity[: 5 - x, max(-y, 0) : 4 - max(y, 0), max(-z, 0) : 6 - max(z, 0)]
        assert (ahead != behind).all()


def test_only_the_two_connectivities() -> None:
    with pytest.raises(InputError, match=r"^connectivity must be 6, 26 or None \(both\), not 18\.$"):
        is_simple(np.zeros(1, dtype=np.int32), 18)
    assert is_simple(np.zeros(0, dtype=np.int32)).shape == (0,)


@pytest.mark.long
def test_number_of_simple_neighborhoods_is_the_known_one() -> None:
    """25,985,144 of all 2^26, as in the literature; mirror images are counted together."""
    middle = np.arange(1 << 8, dtype=np.int32)
    middle = (middle & 0xF) << 9 | (middle >> 4) << 14
    simple = 0
    for below in range(1 << 9):
        above = np.arange(below, 1 << 9, dtype=np.int32)[:, None]
        found = is_simple((below | middle | above << 18).ravel(), 26).reshape(len(above), -1).sum(1)
        simple += 2 * int(found.sum()) - int(found[0])
    assert simple == 25_985_144
