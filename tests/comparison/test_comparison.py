"""Differences of two solids: each kind is named and found where it was planted."""

from __future__ import annotations

import json

import numpy as np
import pytest

from topokit.comparison.result import Comparison
from topokit.comparison.solids import compare_solids
from topokit.core.grid.grid import Grid
from topokit.errors import InputError

GRID = Grid((24, 24, 24), (0.5, 0.5, 0.5), (10.0, 0.0, 0.0))


def box(*bounds: tuple[int, int]) -> np.ndarray:
    solid = np.zeros((24, 24, 24), bool)
    solid[tuple(slice(*side) for side in bounds)] = True
    return solid


BAR = box((4, 20), (10, 14), (10, 14))
RING = box((4, 20), (4, 20), (10, 13)) & ~box((8, 16), (8, 16), (10, 13))
SHELL = box((4, 20), (4, 20), (4, 20)) & ~box((7, 17), (7, 17), (7, 17))
GAP = box((11, 13), (0, 24), (0, 24))
SLIT = box((11, 12), (3, 9), (10, 13))
CHANNEL = box((11, 13), (11, 13), (3, 8))
PINHOLE = box((11, 13), (5, 7), (10, 13))
BRIDGE = box((8, 16), (11, 13), (11, 12))
SPECK = box((0, 2), (0, 3), (0, 2))
BUBBLE = box((5, 6), (11, 12), (11, 12))
WALL = box((7, 17), (7, 17), (11, 13))
PLUG = RING | box((8, 16), (8, 16), (11, 12))
KINDS = {  # pairs with the kind of difference, its dimension, and the voxels in which they differ
    "extra part": (BAR | SPECK, BAR, 0, SPECK),
    "split part": (BAR & ~GAP, BAR, 0, BAR & GAP),
    "lost part": (BAR, BAR | SPECK, 0, SPECK),
    "merged part": (BAR, BAR & ~GAP, 0, BAR & GAP),
    "hole": (RING & ~PINHOLE, RING, 1, PINHOLE),
    "bridge": (RING | BRIDGE, RING, 1, BRIDGE),
    "filled tunnel": (PLUG, RING, 1, PLUG & ~RING),
    "broken loop": (RING & ~SLIT, RING, 1, RING & SLIT),
    "bubble": (BAR & ~BUBBLE, BAR, 2, BUBBLE),
    "split cavity": (SHELL | WALL, SHELL, 2, WALL),
    "sealed cavity": (SHELL, SHELL & ~CHANNEL, 2, SHELL & CHANNEL),
    "filled cavity": (BAR, BAR & ~BUBBLE, 2, BUBBLE),
    "merged cavity": (SHELL, SHELL | WALL, 2, WALL),
    "opened cavity": (SHELL & ~CHANNEL, SHELL, 2, SHELL & CHANNEL),
}
SPURIOUS = [*KINDS][0:2] + [*KINDS][4:6] + [*KINDS][8:11]


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_named_and_found(kind: str, connectivity: int) -> None:
    first, second, dimension, planted = KINDS[kind]
    found = compare_solids(first, second, GRID, connectivity=connectivity)
    [one] = found.features
    assert (one.kind, one.dimension) == (kind, dimension)
    assert one.error == ("spurious" if kind in SPURIOUS else "missing")
    assert (getattr(found, one.error)[dimension], sum(found.betti_matching_error)) == (1, 1)
    low, high = (np.argwhere(planted).min(0) - 0.5) * 0.5, (np.argwhere(planted).max(0) + 0.5) * 0.5
    offset = np.array(GRID.origin)
    np.testing.assert_allclose(one.cause or one.bounds, (low + offset, high + offset))
    if one.cause is None:
        assert one.width == 0.5
    if dimension == 1:
        assert one.loop is not None
        steps = np.linalg.norm(np.roll(one.loop, -1, 0) - one.loop, axis=1)
        np.testing.assert_allclose(steps, 0.5)
        assert one.length == pytest.approx(steps.sum())


def test_a_comparison_in_words_and_as_json() -> None:
    found = compare_solids(RING & ~PINHOLE, RING, GRID, names=("pred.tif", "truth.tif"))
    assert str(found) == (
        "pred.tif against truth.tif: parts 1 matched, 0 missing, 0 spurious; tunnels 1 matched, 0 missing, 1 spurious; "
        "cavities 0 matched, 0 missing, 0 spurious"
    )
    assert found.text().splitlines()[1] == "  - spurious hole at (15.750, 2.750, 5.500): width 0.5, loop of length 4"
    read = json.loads(found.to_json())
    assert read["betti_error"] == read["betti_matching_error"] == [0, 1, 0]
    assert (read["features"][0]["kind"], len(read["features"][0]["loop"])) == ("hole", 8)
    assert ("_find" in read, read["agreement"]["tolerance"]) == (False, 0.5)
    same = compare_solids(RING, RING)
    assert (same.is_same, same.features) == (True, ())
    assert str(same) == "a against b: the same topology, 1 part, 1 tunnel, 0 cavities"


def test_agreement_is_that_of_the_formulas() -> None:
    first, second = box((4, 14), (4, 14), (4, 14)), box((5, 14), (4, 14), (4, 14))
    found = compare_solids(first, second, GRID, tolerance=0.6).agreement
    assert found.dice == pytest.approx(2 * 900 / 1900)
    assert (found.surface_dice, found.hausdorff_95) == (1.0, pytest.approx(0.5))
    itself = compare_solids(RING, RING).agreement
    assert (itself.dice, itself.cl_dice, itself.surface_dice, itself.voi) == (1.0, 1.0, 1.0, (0.0, 0.0))
    halves = compare_solids(first & ~GAP, first).agreement
    assert halves.voi is not None
    assert halves.voi[0] > halves.voi[1]
    nothing = compare_solids(first & False, first).agreement
    assert (nothing.dice, nothing.cl_dice, nothing.surface_dice, nothing.voi) == (0.0, None, None, None)


def test_grids_must_be_the_same() -> None:
    with pytest.raises(InputError, match=r"\(24, 24, 24\) and \(23, 24, 24\)"):
        compare_solids(BAR, BAR[1:])


def test_an_empty_prediction_misses_everything() -> None:
    found: Comparison = compare_solids(np.zeros_like(RING), RING)
    assert (found.betti_a, found.missing, found.spurious) == ((0, 0, 0), (1, 1, 0), (0, 0, 0))
    assert [one.kind for one in found.features] == ["lost part", "broken loop"]
