"""The topology that a loss asks for, as Betti numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from topokit.core.homotopy.nearest_solid import Betti
from topokit.errors import InputError
from topokit.losses.checks import check_count


@dataclass(frozen=True)
class Goal:
    """Betti numbers of a solid, or of each of its components.

    Attributes:
        betti: components, tunnels and cavities of the whole solid.
        by_component: Betti numbers of each component, the largest component first; empty if only `betti` matters.
    """

    betti: Betti
    by_component: tuple[Betti, ...] = ()

    @classmethod
    def of(cls, genus: int | Sequence[int], components: int, cavities: int) -> Goal:
        """The goal with these numbers; the arguments are those of `TopologyLoss`.

        Raises:
            InputError: if a number is not an integer or too small, or a sequence of genera contradicts the others.
        """
        check_count("components", components, 1)
        check_count("cavities", cavities, 0)
        genera = genus if isinstance(genus, Sequence) else (genus,)
        for number in genera:
            check_count("genus", number, 0)
        if not isinstance(genus, Sequence):
            return cls((int(components), int(genus), int(cavities)))
        if not genera or cavities or components not in (1, len(genera)):
            raise InputError(
                f"a list of genera needs one genus for each component, and cavities=0; got {len(genera)} with "
                f"components={components} and cavities={cavities}."
            )
        by_component = tuple((1, int(number), 0) for number in genera)
        return cls((len(genera), sum(betti[1] for betti in by_component), 0), by_component)
