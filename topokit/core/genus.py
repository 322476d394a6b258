"""The genus of a surface from its Euler characteristic, boundary loops and components."""

from __future__ import annotations

from typing import TypeVar

from topokit.core.arrays import Integers

Count = TypeVar("Count", int, Integers)


def genus_of(euler: Count, boundary_loops: Count | int = 0, components: int = 1) -> Count:
    """Handles of an orientable surface, g = (2c − b − χ)/2; of arrays element by element."""
    return (2 * components - boundary_loops - euler) // 2


def fitting_genus(euler: int, boundary_loops: int, components: int) -> int | None:
    """Handles of an orientable surface, or None if no such surface has these numbers: g would be negative or a half."""
    doubled = 2 * components - boundary_loops - euler
    return doubled // 2 if components > 0 and doubled >= 0 and doubled % 2 == 0 else None
