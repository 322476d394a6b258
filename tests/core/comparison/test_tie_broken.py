"""Betti matching: its definition on small grids, and numbers of the official program."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from topokit.core.comparison.pair import SolidPair
from topokit.core.comparison.tie_broken import betti_matched


def drawn_pair(seed: int, shape: tuple[int, int, int]):
    generator = np.random.default_rng(seed)
    values, share = generator.random(shape), (0.45, 0.3, 0.08)[seed % 3]
    return values > share, values + 0.25 * generator.random(shape) > share * 1.2


OFFICIAL = {  # numbers of Betti-Matching-3D as topolosses 0.2.0 ships it, without the part that never ends
    0: (3, 60, 0),
    1: (0, 41, 0),
    2: (0, 0, 2),
    3: (5, 53, 0),
    4: (1, 70, 0),
    8: (0, 0, 3),
    14: (0, 0, 2),
}


@pytest.mark.parametrize("seed", OFFICIAL)
def test_equals_the_official_program(seed: int) -> None:
    parts, tunnels, cavities = OFFICIAL[seed]
    assert betti_matched(*drawn_pair(seed, (9, 10, 11))) == (parts + 1, tunnels, cavities)


def test_it_is_no_invariant_and_at_least_what_is() -> None:
    found = [betti_matched(*drawn_pair(seed, (9, 10, 11))) for seed in OFFICIAL]
    invariant = [SolidPair(*drawn_pair(seed, (9, 10, 11)), 6).numbers.matched for seed in OFFICIAL]
    assert (np.array(found) >= invariant).all()
    turned = [betti_matched(*(one[::-1] for one in drawn_pair(seed, (9, 10, 11)))) for seed in OFFICIAL]
    assert turned != found
    empty, full = np.zeros((3, 4, 5), bool), np.ones((3, 4, 5), bool)
    assert [betti_matched(*pair) for pair in ((empty, full), (empty, empty), (full, full))] == [(0,) * 3] * 2 + [
        (1, 0, 0)
    ]


@pytest.mark.parametrize("seed", range(6))
def test_equals_the_definition(seed: int) -> None:
    """Bars of both solids are matched if their images meet in one bar of the union."""
    first, second = drawn_pair(seed, (4, 5, 3))
    assert betti_matched(first, second) == by_definition(first, second)


def by_definition(first, second) -> tuple[int, ...]:
    grid = [cells_with_values(solid) for solid in (first, second, first | second)]
    order = [sorted(values, key=lambda cell, v=values: (v[cell], *position(cell))) for values in grid]
    bars = [persistence(one, one) for one in order]
    images = [persistence(own, order[2]) for own in order[:2]]
    targets = {death for birth, death in bars[2] if spans(birth, death, grid[2], grid[2])}
    ends: list[dict] = []
    for own, image, values in zip(bars, images, grid, strict=False):
        births = {birth for birth, death in own if spans(birth, death, values, values)}
        ends.append({death: birth for birth, death in image if birth in births and death in targets})
    common = [dimension(ends[0][death]) for death in ends[0].keys() & ends[1].keys()]
    return tuple(common.count(k) for k in range(3))


def spans(birth, death, born, dead) -> bool:
    return born[birth] < (np.inf if death is None else dead[death])


def cells_with_values(solid) -> dict[tuple[int, int, int], int]:
    """Cells by twice their middle: 0 in the solid, 1 outside."""
    found = {}
    for cell in product(*(range(2 * n - 1) for n in solid.shape)):
        corners = product(*((x // 2, x // 2 + 1) if x % 2 else (x // 2,) for x in cell))
        found[cell] = int(not all(solid[corner] for corner in corners))
    return found


def dimension(cell) -> int:
    return sum(x % 2 for x in cell)


def position(cell) -> tuple[int, ...]:
    """Lowest corner and type, as the program numbers cells."""
    odd = [axis for axis in range(3) if cell[axis] % 2]
    kind = odd[0] if len(odd) == 1 else min({0, 1, 2} - {*odd}, default=0) if len(odd) == 2 else 0
    return (*(x // 2 for x in cell), kind)


def persistence(rows, columns) -> list[tuple]:
    """Pairs (birth, death) of cells: births in the order of rows, deaths in that of columns; None if there is none."""
    number = {cell: k for k, cell in enumerate(rows)}
    found, killed = [], set()
    for k in range(3, 0, -1):
        pivots: dict[int, int] = {}
        for cell in (c for c in columns if dimension(c) == k):
            column = 0
            for axis in range(3):
                if cell[axis] % 2:
                    for step in (-1, 1):
                        column ^= 1 << number[(*cell[:axis], cell[axis] + step, *cell[axis + 1 :])]
            while column and column.bit_length() in pivots:
                column ^= pivots[column.bit_length()]
            if column:
                pivots[column.bit_length()] = column
                birth = rows[column.bit_length() - 1]
                found.append((birth, cell))
                killed.add(birth)
    return found + [(cell, None) for cell in rows if dimension(cell) == 0 and cell not in killed]
