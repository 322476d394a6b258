"""What topology a loss asks for: the Euler characteristic of the surface, and the Betti numbers of the solid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real

from topokit.core.homotopy.nearest_solid import Betti
from topokit.errors import InputError

Target = float | Sequence[float] | None


@dataclass(frozen=True)
class Goal:
    """A wanted topology.

    Attributes:
        euler: of the surface, summed over its components.
        parts: Betti numbers of each component of the solid, largest component first, where they are asked for one by
            one; empty if only their sum is.
        betti: of the whole solid; None where the Euler characteristic is all that is asked for.
    """

    euler: float
    betti: Betti | None = None
    parts: tuple[Betti, ...] = ()


def goal_of(target: Target, genus: int | Sequence[int] | None, components: int | None, cavities: int) -> Goal:
    """The goal that a user's numbers describe.

    Args:
        target: Euler characteristic of the surface, or one for each component of the solid.
        genus: instead of the target: total number of handles, or one number for each component of the solid.
        components: parts of the solid; None asks for nothing beyond the Euler characteristic. A sequence of targets or
            genera counts them itself.
        cavities: of the solid; its surface has components + cavities components.

    Raises:
        InputError: if both or neither of target and genus are given, they are not numbers, or no solid has these.
    """
    if (target is None) == (genus is None):
        raise InputError(f"give either target or genus: got target={target!r} and genus={genus!r}.")
    name, wanted = ("genus", genus) if target is None else ("target", target)
    numbers = wanted if isinstance(wanted, Sequence) else (wanted,)
    if not numbers or not all(isinstance(number, Real) and math.isfinite(number) for number in numbers):
        raise InputError(f"{name} must be a finite number, or a list of one for each component, not {wanted!r}.")
    if isinstance(wanted, Sequence):
        if cavities or components not in (1, len(wanted)):
            raise InputError(
                f"one {name} per component goes with cavities=0, and says itself that there are {len(wanted)} "
                f"components; got components={components!r} and cavities={cavities!r}."
            )
        parts = tuple(_betti(1, 0, _euler(number, target is None, 1, 0)) for number in wanted)
        betti = (len(parts), sum(part[1] for part in parts), 0)
        return Goal(2.0 * (betti[0] - betti[1]), betti, parts)
    if components is None:
        if genus is not None:
            raise InputError("genus needs components: without them it does not say what χ is.")
        if cavities:
            raise InputError("cavities need components: χ alone does not tell them from components.")
        return Goal(float(wanted))  # type: ignore[arg-type]
    euler = _euler(wanted, target is None, components, cavities)  # type: ignore[arg-type]
    return Goal(euler, _betti(components, cavities, euler))


def _euler(number: float, is_genus: bool, components: int, cavities: int) -> float:
    return 2.0 * (components + cavities - number) if is_genus else float(number)


def _betti(components: int, cavities: int, euler: float) -> Betti:
    counted = isinstance(components, Integral) and isinstance(cavities, Integral)
    tunnels = components + cavities - euler / 2
    if not counted or components < 1 or cavities < 0 or tunnels < 0 or tunnels != int(tunnels):
        raise InputError(
            f"no closed surface of a solid with components={components} and cavities={cavities} has χ = {euler:g}: "
            "χ = 2 (components + cavities − genus). Change components, or pass components=None to ask for χ alone."
        )
    return components, int(tunnels), cavities
