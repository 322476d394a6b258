"""Monitor that counts the exact topology of a field during training, and says when the goal is reached."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from numbers import Integral

from torch import nn

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.errors import InputError
from topokit.losses.checks import check_count
from topokit.losses.field_loss import CountedSolid, FieldLoss
from topokit.losses.source import FieldSource, Source
from topokit.report.certificate import Certificate
from topokit.shape import Shape

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
    """Counts the topology of a field every few steps, logs it, and says when the goal of a loss is reached.

    The count is exact for the cubical complex of the grid: no τ, no gradient. It is logged to the logger "topokit" at
    level INFO.

    Args:
        loss: the loss in use, any `FieldLoss`. The monitor asks it whether its goal is met, and shares its level and
            resolution. Without one there is no goal, and the topology is only recorded.
        every: steps between counts.
        patience: number of successive counts that must meet the goal.
        level: of a plain field; by default that of the loss, or 0.
        connectivity: 6 or 26, of a plain field and of samples; by default that of the loss, or 26.
        resolution: for shapes without a field; by default that of the loss, or 64.
        certify: seconds for a proof by `Shape.certify`, once the count has met the goal `patience` times, of networks
            and functions only. Training may stop when it proves the count; without a proof the counting starts anew.

    Attributes:
        history: one `TopologyRecord` per count.
        certificate: of the last proof that was tried, or None.

    Raises:
        InputError: if an argument has a wrong type or value.

    Example:
        >>> import topokit as tk, torch
        >>> monitor = tk.TopologyMonitor(tk.TopologyLoss(genus=0), every=10, patience=1)
        >>> field = torch.ones(4, 4, 4)
        >>> [step for step in range(30) if monitor(step, field)]
        [0, 10, 20]
        >>> monitor.columns()["euler"]
        [2, 2, 2]
    """

    def __init__(
        self,
        loss: FieldLoss | None = None,
        *,
        every: int = 25,
        patience: int = 2,
        level: float | None = None,
        connectivity: int | None = None,
        resolution: int | None = None,
        certify: float | None = None,
    ) -> None:
        if not isinstance(loss, FieldLoss | None):
            raise InputError(f"loss must be a TopologyLoss, an EulerLoss, another FieldLoss or None, not {loss!r}.")
        check_count("every", every, 1)
        check_count("patience", patience, 1)
        if certify is not None and not certify > 0:
            raise InputError(f"certify must be a positive number of seconds, not {certify!r}.")
        shared = loss.source if loss else FieldSource(0.0, DEFAULT_CONNECTIVITY, 64)
        self._source = FieldSource(
            shared.level if level is None else level,
            shared.connectivity if connectivity is None else connectivity,
            shared.resolution if resolution is None else resolution,
        )
        self._loss = loss
        self._every = every
        self._patience = patience
        self._certify = certify
        self._n_met = 0
        self.certificate: Certificate | None = None
        self.history: list[TopologyRecord] = []

    def __call__(self, step: int, source: Source | Callable[[], Source]) -> bool:
        """Count, if it is time; True when the goal has been met `patience` times in a row, and proven if that is asked
        for: training may stop.

        Args:
            step: number of the training step.
            source: what the loss is called with: one field (X, Y, Z) or a shape; or a function without arguments that
                returns it, called only when it is time.

        Raises:
            InputError: if the step is not an integer, the source is a batch or none of these, or it cannot be proven
                and `certify` is given.
        """
        if not isinstance(step, Integral):
            raise InputError(f"the first argument is the number of the step, an integer; got {type(step).__name__}.")
        if step % self._every:
            return False
        given = _call(source)
        found = self._source(given)
        if len(found) != 1:
            raise InputError(f"a monitor watches one field; got a batch of {len(found)}. Use one monitor for each.")
        solid = CountedSolid.of(found[0].field)
        record = TopologyRecord(int(step), solid.euler, *solid.betti)
        self.history.append(record)
        _log.info("step %d: χ %d, components %d, tunnels %d, cavities %d", *asdict(record).values())
        self._n_met = self._n_met + 1 if self._loss is not None and self._loss.is_met(solid) else 0
        if self._n_met < self._patience:
            return False
        if self._certify is not None and not self._is_proven(given, solid, self._certify):
            self._n_met = 0
            return False
        return True

    def _is_proven(self, source: Source, solid: CountedSolid, seconds: float) -> bool:
        """Whether bounds prove what was counted."""
        if not isinstance(source, Shape):
            raise InputError(f"certify= proves level sets of functions, tk.from_sdf(net); got {type(source).__name__}.")
        self.certificate = proof = source.certify(seconds)
        _log.info("proof: %s", proof)
        if proof.verdict != "certain" or proof.components is None:
            return False
        components, _, cavities = solid.betti
        return (proof.euler, len(proof.components)) == (solid.euler, components + cavities)

    def columns(self) -> dict[str, list[int]]:
        """The history as columns, to plot or to write."""
        names = [field.name for field in fields(TopologyRecord)]
        return {name: [getattr(record, name) for record in self.history] for name in names}


def _call(source: Source | Callable[[], Source]) -> Source:
    """The source itself, or what the function returns."""
    if not callable(source):
        return source
    if isinstance(source, nn.Module) or not _takes_no_arguments(source):
        raise InputError(
            "expected a field, a Shape, or a function without arguments that returns one; got "
            f"{type(source).__name__}, which needs arguments. Wrap a network as a shape: tk.from_sdf(net)."
        )
    return source()


def _takes_no_arguments(function: Callable[..., object]) -> bool:
    try:
        inspect.signature(function).bind()
    except TypeError:
        return False
    return True
