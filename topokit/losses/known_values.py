"""Values of a field from call to call: all of them every so often, in between those near the level."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from topokit.core.grid.field import Field, median_step_at_crossings

# A network in training moves its level set by far less than a cell from one evaluation to the next. What lies two cells
# away is neither decisive for the topology loss, nor does it change its side unseen before the next full evaluation.
_BAND_CELLS = 2.0  # distance from the level, in typical changes over one cell, up to which values are evaluated anew
_BAND_TAUS = 8.0  # the same in τ: a voxel farther off has a slope below 1/3000 of that at the level


class KnownValues:
    """The values of one field without a graph; of a function only those are evaluated that may have changed sides."""

    def __init__(self, whole_every: int) -> None:
        """Args: whole_every: evaluations from one of the whole field to the next."""
        self._whole_every = whole_every
        self._known: Tensor | None = None
        self._width = float("inf")
        self._n_evaluations = 0

    def update(self, field: Field, tau: float | None, vertices: Tensor | None = None) -> Tensor:
        """The values (X, Y, Z) of the field as it is now, exact within the band around the level.

        Args:
            field: on the same grid in every call.
            tau: scale of the levels that matter, in units of the field; None for about one cell.
            vertices: (M, 3) int64, grid vertices whose values are needed wherever they are.
        """
        is_whole = self._known is None or self._n_evaluations % self._whole_every == 0
        if is_whole or self._known is None:
            values = field.detached()
        else:
            values = field.updated(self._known, self._width, vertices)
        self._n_evaluations += 1
        if not field.is_costly:
            return values
        if is_whole:
            self._width = _band(values, tau)
        self._known = values
        return values

    def get_state(self) -> dict[str, Any]:
        """What is known, as tensors and numbers."""
        return {"known": self._known, "width": self._width, "n_evaluations": self._n_evaluations}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned."""
        self._known, self._width, self._n_evaluations = state["known"], state["width"], state["n_evaluations"]


def _band(values: Tensor, tau: float | None) -> float:
    """Half the width of the band, in units of the field; infinite if the field has one sign."""
    is_inside = values > 0
    if not bool(is_inside.any()) or bool(is_inside.all()):
        return float("inf")
    step = median_step_at_crossings(torch.where(values.isfinite(), values, torch.where(is_inside, 1, -1)))
    return max(_BAND_CELLS * step, _BAND_TAUS * (tau or 0))
