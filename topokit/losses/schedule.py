"""Schedule that lowers τ during training."""

from __future__ import annotations

import math
from dataclasses import dataclass

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.core.grid.field import default_tau
from topokit.errors import InputError
from topokit.losses.checks import check_count
from topokit.losses.source import FieldSource, Source


@dataclass(frozen=True)
class TauSchedule:
    """Geometric decay of τ from `coarsest` to `finest`, where it stays for the last fifth of the steps.

    Attributes:
        coarsest: first τ, in units of the field: about the depth of the hole to close.
        finest: last τ: well below the field's change over one cell.
        n_steps: number of training steps.

    Raises:
        InputError: unless 0 < finest <= coarsest < ∞, and n_steps is an integer of at least 1.

    Example:
        >>> schedule = TauSchedule(0.2, 0.05, 100)
        >>> [schedule(step) for step in (0, 40, 80, 1000)]
        [0.2, 0.1, 0.05, 0.05]
    """

    coarsest: float
    finest: float
    n_steps: int

    def __post_init__(self) -> None:
        check_count("n_steps", self.n_steps, 1)
        if not 0 < self.finest <= self.coarsest < math.inf:
            raise InputError(
                f"a schedule needs 0 < finest <= coarsest < ∞; got finest={self.finest:g}, coarsest={self.coarsest:g}."
            )

    @classmethod
    def for_field(cls, source: Source, n_steps: int, *, level: float = 0.0, resolution: int = 64) -> TauSchedule:
        """The schedule from a field's spread, the median of |F - level|, down to the default τ of the losses.

        Args:
            source: one field (X, Y, Z), or a shape: what the loss will be called with.
            n_steps: number of training steps.
            level: of a plain field.
            resolution: for shapes without a field: that of the loss.

        Raises:
            InputError: if the field has the same sign everywhere, or the source is a batch.
        """
        fields = FieldSource(level, DEFAULT_CONNECTIVITY, resolution)(source)
        if len(fields) != 1:
            raise InputError(f"a schedule is for one field; got a batch of {len(fields)}.")
        values = fields[0].detached()
        finest = default_tau(values)
        return cls(max(finest, float(values[values.isfinite()].abs().median())), finest, n_steps)

    def __call__(self, step: int) -> float:
        """τ at a step, counted from 0."""
        share = min(step / (0.8 * self.n_steps), 1.0)
        return float(self.coarsest * (self.finest / self.coarsest) ** share)
