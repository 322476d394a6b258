"""Primitive sets of integer vectors, against the greatest common divisor of all maximal minors."""

from __future__ import annotations

from itertools import combinations
from math import gcd

import numpy as np

from topokit.core.handles.integer_lattice import PrimitiveBasis


def is_primitive(rows: list[np.ndarray]) -> bool:
    matrix = np.array(rows)
    minors = (round(np.linalg.det(matrix[:, list(columns)])) for columns in combinations(range(5), len(rows)))
    return gcd(*minors) == 1


def test_takes_exactly_what_extends_a_basis() -> None:
    generator = np.random.default_rng(0)
    answers = []
    for _ in range(60):
        lattice, rows = PrimitiveBasis(5), []
        for vector in generator.integers(-3, 4, size=(8, 5)):
            expected = len(rows) < 5 and is_primitive([*rows, vector])
            assert lattice.add(vector) == expected, (rows, vector)
            rows += [vector] * expected
            answers.append(expected)
        assert lattice.count == len(rows)
    assert 0.2 < np.mean(answers) < 0.8


def test_multiples_and_zero_are_refused() -> None:
    lattice = PrimitiveBasis(3)
    assert not lattice.add(np.array([0, 0, 0]))
    assert not lattice.add(np.array([3, 6, 0]))
    assert lattice.add(np.array([3, 5, 0]))
    assert not lattice.add(np.array([-3, -5, 0]))
    assert not lattice.add(np.array([3, 5, 3]))
    assert lattice.add(np.array([3, 5, 1]))
