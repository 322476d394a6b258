"""How τ falls in the course of training."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torch import Tensor

from topokit.core.grid.field import median_step_at_crossings
from topokit.errors import InputError
from topokit.losses.source import FieldSource
from topokit.shape import Shape


@dataclass(frozen=True)
class TauSchedule:
    """τ falls geometrically from `coarsest` to `finest`, and stays there for the last fifth of the steps.

    Attributes:
        coarsest: first τ, in units of the field: about the depth of the hole that is to be closed.
        finest: last τ: well below the field's change over one cell.
        n_steps: of the training.

    Raises:
        InputError: unless 0 < finest <= coarsest < ∞ and there are steps.

    Example:
        >>> schedule = TauSchedule(0.2, 0.05, 100)
        >>> [schedule(step) for step in (0, 40, 80, 1000)]
        [0.2, 0.1, 0.05, 0.05]
    """

    coarsest: float
    finest: float
    n_steps: int

    def __post_init__(self) -> None:
        if not 0 < self.finest <= self.coarsest < math.inf or self.n_steps < 1:
            raise InputError(
                f"a schedule needs 0 < finest <= coarsest < ∞ and n_steps >= 1, got finest={self.finest:g}, "
                f"coarsest={self.coarsest:g} and n_steps={self.n_steps}."
            )

    @classmethod
    def for_field(cls, source: Tensor | Shape, n_steps: int, *, level: float = 0.0) -> TauSchedule:
        """From the field's own spread, the median of |F - level|, to half its typical change over one cell.

        Args:
            source: one field (X, Y, Z), or a shape: what the loss is going to be given.
            n_steps: of the training.
            level: of a plain field.

        Raises:
            InputError: if the field has the same sign everywhere, or there are several.
        """
        fields = FieldSource(level, 6, 64)(source)
        if len(fields) != 1:
            raise InputError(f"a schedule is that of one field; got a batch of {len(fields)}.")
        values = fields[0].detached()
        finest = 0.5 * median_step_at_crossings(values)
        return cls(max(finest, float(values[values.isfinite()].abs().median())), finest, n_steps)

    def __call__(self, step: int) -> float:
        """τ at a step, counted from 0."""
        share = min(step / (0.8 * self.n_steps), 1.0)
        return float(self.coarsest * (self.finest / self.coarsest) ** share)
