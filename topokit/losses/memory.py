"""What losses remember of a field from call to call: its values near the level, for one."""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from torch import Tensor

from topokit.core.grid.field import Field, median_step_at_crossings

# A network in training moves its level set by far less than a cell from one evaluation to the next. What lies two cells
# away is neither decisive for the topology loss, nor does it change its side unseen before the next full evaluation.
_BAND_CELLS = 2.0  # distance from the level, in typical changes over one cell, up to which values are evaluated anew
_BAND_TAUS = 8.0  # the same in τ: a voxel farther off has a slope below 1/3000 of that at the level


class Memory:
    """An object whose memory can be put into a `state_dict`: as tensors, numbers and containers of these only.

    Attributes:
        remembers: names of the attributes that are its memory. Where one is a `Memory`, or a list of some, their
            memories are parts of this one.
    """

    remembers: ClassVar[tuple[str, ...]] = ()

    def get_state(self) -> dict[str, Any]:
        """What is remembered."""
        return {name: _state_of(getattr(self, name)) for name in self.remembers}

    def set_state(self, state: dict[str, Any]) -> None:
        """Remember what `get_state` returned."""
        for name in self.remembers:
            setattr(self, name, _restored(getattr(self, name), state[name]))


def _state_of(value: Any) -> Any:
    if isinstance(value, list):
        return [_state_of(part) for part in value]
    return value.get_state() if isinstance(value, Memory) else value


def _restored(value: Any, state: Any) -> Any:
    """What an attribute becomes by what `_state_of` it was."""
    if isinstance(value, list):
        return [_restored(part, its) for part, its in zip(value, state, strict=True)]
    if isinstance(value, Memory):
        value.set_state(state)
        return value
    return state


class KnownValues(Memory):
    """The values of one field without a graph; of a function only those are evaluated that may have changed sides."""

    remembers = ("_known", "_width", "_n_evaluations")

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


def _band(values: Tensor, tau: float | None) -> float:
    """Half the width of the band, in units of the field; infinite if the field has one sign."""
    is_inside = values > 0
    if not bool(is_inside.any()) or bool(is_inside.all()):
        return float("inf")
    step = median_step_at_crossings(torch.where(values.isfinite(), values, torch.where(is_inside, 1, -1)))
    return max(_BAND_CELLS * step, _BAND_TAUS * (tau or 0))
