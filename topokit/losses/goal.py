"""What a topology loss asks for: Betti numbers of a solid or of each component, at most some, or those of a target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from topokit.core.arrays import Booleans
from topokit.core.homotopy.nearest_solid import Betti
from topokit.errors import InputError
from topokit.losses.checks import check_count
from topokit.losses.field_loss import CountedSolid


@dataclass(frozen=True, eq=False)
class Goal:
    """The wanted topology of one solid.

    Attributes:
        betti: components, tunnels and cavities of the whole solid.
        by_component: Betti numbers of each component, the largest component first; empty if only `betti` matters.
        at_most: whether fewer are right, too.
        target: (X, Y, Z) bool, a solid whose features are wanted in their places; then nothing else matters.
    """

    betti: Betti = (1, 0, 0)
    by_component: tuple[Betti, ...] = ()
    at_most: bool = False
    target: Booleans | None = None

    @classmethod
    def of_genus(cls, genus: int | Sequence[int], components: int, cavities: int, at_most: bool) -> Goal:
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
            return cls((int(components), int(genus), int(cavities)), at_most=at_most)
        if at_most or not genera or cavities or components not in (1, len(genera)):
            raise InputError(
                "a list of genera needs one genus for each component, cavities=0 and at_most=False; got "
                f"{len(genera)} with components={components}, cavities={cavities} and at_most={at_most}."
            )
        by_component = tuple((1, int(number), 0) for number in genera)
        return cls((len(genera), sum(betti[1] for betti in by_component), 0), by_component)

    def is_met(self, solid: CountedSolid) -> bool:
        """Whether a solid has the wanted Betti numbers, and where they were given one by one, each component too."""
        if self.at_most:
            return all(have <= most for have, most in zip(solid.betti, self.betti, strict=True))
        return solid.betti == self.betti and (not self.by_component or solid.by_component == self.by_component)

    def __str__(self) -> str:
        if self.target is not None:
            return "the topology of the target"
        return f"{'at most ' * self.at_most}the Betti numbers {self.by_component or self.betti}"


def betti_rows(betti: Any) -> Tensor:
    """Betti numbers (..., 3) int64 from an array or sequences of three, or in the plane of two, non-negative integers.

    Raises:
        InputError: if they are something else.
    """
    given = betti if isinstance(betti, Tensor) else None
    try:
        rows = torch.as_tensor(np.asarray(betti)) if given is None else given.detach().cpu()
    except (TypeError, ValueError):
        rows = torch.empty(0)
    is_integer = not rows.is_floating_point() and not rows.is_complex() and rows.dtype != torch.bool
    if not is_integer or rows.ndim == 0 or rows.shape[-1] not in (2, 3) or bool((rows < 0).any()):
        raise InputError(
            "betti must be (components, tunnels, cavities), in the plane (components, holes), as integers of at least "
            f"0, or an array of such rows; got {betti!r}."
        )
    return torch.nn.functional.pad(rows.long(), (0, 3 - rows.shape[-1]))


def goals_of(
    goal: Goal | None,
    at_most: bool,
    betti: Any,
    target: Tensor | None,
    batch: tuple[int, ...],
    grids: Sequence[tuple[int, int, int]],
) -> list[Goal]:
    """The goal of each item of a batch.

    Args:
        goal: the one that is asked for if there is neither `betti` nor `target`.
        at_most: see `Goal`; for `betti`.
        betti: rows that broadcast to the batch, or None.
        target: solids (..., X, Y, Z) that broadcast to the batch, or None.
        batch: shape of the batch.
        grids: shape (X, Y, Z) of each field.

    Raises:
        InputError: if there is no goal or more than one, or shapes do not fit.
    """
    if betti is not None and target is not None:
        raise InputError("pass betti or target, not both: a target has Betti numbers of its own.")
    if betti is not None:
        rows = _expanded(betti_rows(betti), (*batch, 3), "betti").reshape(-1, 3).tolist()
        return [Goal((b0, b1, b2), at_most=at_most) for b0, b1, b2 in rows]
    if target is not None:
        if not isinstance(target, Tensor) or target.is_floating_point() or target.is_complex():
            raise InputError("target must be a mask, a tensor of bool or of integers (0 is background).")
        masks = _expanded(target.detach().cpu() != 0, (*batch, *grids[0]), "target")
        return [Goal(target=mask.numpy()) for mask in masks.reshape(-1, *grids[0])]
    if goal is None:
        raise InputError(
            "there is no goal: make the loss with genus=… or betti=…, or call it with betti=… or target=…."
        )
    return [goal] * len(grids)


def _expanded(rows: Tensor, shape: tuple[int, ...], name: str) -> Tensor:
    try:
        return rows.expand(shape)
    except RuntimeError as error:
        raise InputError(
            f"{name} has the shape {tuple(rows.shape)}; it must broadcast to {shape}, the batch of fields."
        ) from error
