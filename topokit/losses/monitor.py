"""The exact topology in the course of training."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from torch import Tensor

from topokit.core.grid.components import betti_by_component, betti_numbers
from topokit.core.homotopy.nearest_solid import Betti
from topokit.errors import InputError
from topokit.losses.goal import Target, goal_of
from topokit.losses.source import FieldSource
from topokit.shape import Shape

Source = Tensor | Shape

_log = logging.getLogger("topokit")


@dataclass(frozen=True)
class TopologyRecord:
    """The topology at one step.

    Attributes:
        step: of the training.
        euler: χ of the surface.
        components, tunnels, cavities: Betti numbers of the solid.
    """

    step: int
    euler: int
    components: int
    tunnels: int
    cavities: int


class TopologyMonitor:
    """Counts the field's topology every few steps, logs it and says when the goal is reached.

    The count is exact for the cubical complex of the grid: no τ, no gradient. It logs to the logger "topokit", at level
    INFO.

    Args:
        target, genus, components, cavities: the goal, as in `EulerLoss`; without target and genus there is none, and
            training is only watched.
        every: steps between counts.
        patience: counts in succession that must meet the goal.
        level: of a plain field.
        connectivity: 6 or 26, of a plain field.
        resolution: grid points along a side, at most, for the winding field of samples.

    Attributes:
        history: one `TopologyRecord` per count.

    Example:
        >>> import topokit as tk, torch
        >>> monitor = tk.TopologyMonitor(genus=0, every=10, patience=1)
        >>> field = torch.ones(4, 4, 4)
        >>> [step for step in range(30) if monitor(step, field)]
        [0, 10, 20]
        >>> monitor.columns()["euler"]
        [2, 2, 2]
    """

    def __init__(
        self,
        target: Target = None,
        *,
        genus: int | Sequence[int] | None = None,
        components: int | None = 1,
        cavities: int = 0,
        every: int = 25,
        patience: int = 2,
        level: float = 0.0,
        connectivity: int = 6,
        resolution: int = 64,
    ) -> None:
        if every < 1 or patience < 1:
            raise InputError(f"every and patience must be at least 1, got {every} and {patience}.")
        has_goal = target is not None or genus is not None
        self._goal = goal_of(target, genus, components, cavities) if has_goal else None
        self._every = every
        self._patience = patience
        self._source = FieldSource(level, connectivity, resolution)
        self._met = 0
        self.history: list[TopologyRecord] = []

    def __call__(self, step: int, source: Source | Callable[[], Source]) -> bool:
        """Count, if it is time; True when the goal has been met `patience` times in succession and training may stop.

        Args:
            step: of the training.
            source: what the loss is given: one field (X, Y, Z) or a shape; or a function that returns it, called only
                when it is time.

        Raises:
            InputError: if the source is a batch, or none of these.
        """
        if step % self._every:
            return False
        fields = self._source(source() if callable(source) else source)
        if len(fields) != 1:
            raise InputError(f"a monitor watches one field; got a batch of {len(fields)}. Use one monitor for each.")
        values, connectivity = fields[0].detached(), fields[0].connectivity
        components, tunnels, cavities = betti_numbers(values, 0.0, connectivity).tolist()
        record = TopologyRecord(step, 2 * (components - tunnels + cavities), components, tunnels, cavities)
        self.history.append(record)
        _log.info("step %d: χ %d, components %d, tunnels %d, cavities %d", *asdict(record).values())
        self._met = self._met + 1 if self._is_met(record, values, connectivity) else 0
        return self._met >= self._patience

    def columns(self) -> dict[str, list[int]]:
        """The history as columns, to plot or to write."""
        rows = [asdict(record) for record in self.history]
        return {name: [row[name] for row in rows] for name in TopologyRecord.__dataclass_fields__}

    def _is_met(self, record: TopologyRecord, values: Tensor, connectivity: int) -> bool:
        if self._goal is None:
            return False
        if self._goal.betti is None:
            return record.euler == self._goal.euler
        if (record.components, record.tunnels, record.cavities) != self._goal.betti:
            return False
        return not self._goal.parts or _betti_by_size(values, connectivity) == self._goal.parts


def _betti_by_size(values: Tensor, connectivity: int) -> tuple[Betti, ...]:
    """Betti numbers of each component, the largest first."""
    table = betti_by_component(values, 0.0, connectivity).tolist()
    return tuple((components, tunnels, cavities) for components, tunnels, cavities in table)
