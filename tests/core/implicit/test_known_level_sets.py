"""Polynomials and trigonometric functions of known topology, and every operation that has bounds, in random boxes."""

from __future__ import annotations

import pytest

from benchmarks.bounded_operations import OPERATIONS, outside
from benchmarks.certified import counted, proof_of
from benchmarks.known_level_sets import KNOWN, SINGULAR

QUICK = [
    "ellipsoid 1 : 5 : 20",
    "smallest sphere, 0.0001",
    "spheres joined by a thin neck",
    "spheres nearly joined",
    "nested spheres",
    "torus with a hole of 0.01",
    "sphere in a torus",
    "genus 2 plate",
    "Chmutov 4, −0.99",
    "Chmutov 4, −1.01",
    "cell of Schwarz's P",
]


@pytest.mark.parametrize("name", QUICK)
def test_what_is_proven_of_known_level_sets_is_right(name: str) -> None:
    known = KNOWN[name]
    assert counted(proof_of(known.function)) == (known.eulers, known.cavities, known.loops)


@pytest.mark.parametrize("name", ["touching inside", "Chmutov 4, −1", "Cayley's cubic", "Whitney's umbrella"])
def test_singular_level_sets_are_never_proven(name: str) -> None:
    assert proof_of(SINGULAR[name], 0.3).components is None


@pytest.mark.parametrize("name", OPERATIONS)
def test_no_box_has_values_or_gradients_outside_of_the_bounds(name: str) -> None:
    assert outside(OPERATIONS[name], 2_000, seed=1) == 0
