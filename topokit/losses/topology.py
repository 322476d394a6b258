"""The topology loss: moves a field until the solid it describes has given Betti numbers."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.core.homotopy.nearest_solid import Betti, Change
from topokit.errors import InputError
from topokit.losses.checks import check_choice, check_count, check_tau
from topokit.losses.field_loss import CountedSolid, FieldLoss, Reduction, batch_shape
from topokit.losses.guard import ComponentGuard, Guard, margin_loss
from topokit.losses.source import Source
from topokit.losses.tracker import SearchOptions, SolidTrack, Tracker, checked_search

DEFAULT_SEARCH = SearchOptions()


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


class TopologyLoss(FieldLoss):
    """Moves a field until its solid has given numbers of components, handles and cavities.

    The loss finds the nearest solid with these Betti numbers, and from it the voxels that decide the topology; it is
    the mean Huber loss of how far these are from their side of the level, in units of `tau`. This opens, closes, joins,
    splits and removes; see docs/topology-loss.md. The topology is asked for in both connectivities, so that any
    mesher agrees, unless voxels meet through an edge or a corner only, as in noise.

    The module remembers the nearest solid of each batch item from call to call: use one module for each field that is
    trained, and call `reset()` before using it for another one. The memory is part of the `state_dict`, and survives
    copying and pickling: a training resumed from a checkpoint goes on as if it had not been interrupted.

    Args:
        genus: number of handles of the surface (the solid's tunnels), summed over components; or a sequence, one for
            each component of the solid, the largest component first.
        components: of the solid. A sequence of genera has one for each component, and sets this number.
        cavities: of the solid; its surface has components + cavities components.
        change: "any", or whether material may only be added ("add") or only removed ("remove").
        level: of a plain field; {field > level} is the solid. A shape has its own.
        search: how often to repeat the expensive steps.
        resolution: for shapes without a field: the most grid points along a side of the winding-number field.
        reduction: "mean", "sum" or "none" over the batch.

    Raises:
        InputError: if an argument has a wrong type or value.

    Example:
        >>> import topokit as tk, torch
        >>> axis = torch.linspace(-1, 1, 32)
        >>> x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
        >>> torus, ball = 0.3 - torch.hypot(torch.hypot(x, y) - 0.5, z), 0.5 - torch.hypot(torch.hypot(x, y), z)
        >>> [bool(tk.TopologyLoss(genus=0)(field, tau=0.02) > 1) for field in (torus, ball)]
        [True, False]
    """

    def __init__(
        self,
        genus: int | Sequence[int],
        *,
        components: int = 1,
        cavities: int = 0,
        change: Change = "any",
        level: float = 0.0,
        search: SearchOptions = DEFAULT_SEARCH,
        resolution: int = 64,
        reduction: Reduction = "mean",
    ) -> None:
        super().__init__(level, DEFAULT_CONNECTIVITY, resolution, reduction)
        check_choice("change", change, ("any", "add", "remove"))
        self.goal = Goal.of(genus, components, cavities)
        self.change: Change = change
        new_track = partial(_new_track, self.goal, change, checked_search(search).search_every)
        self.tracker = Tracker(search, new_track, (self.goal.betti, self.goal.by_component, change))

    def reset(self) -> None:
        """Forget the nearest solids, and the grid around samples."""
        self.source.grids = []
        self.tracker.reset()

    def forward(self, source: Source, tau: float | None = None) -> Tensor:
        """The loss.

        Args:
            source: (..., X, Y, Z) floating-point field, positive inside, on any device; or a shape with a field
                (from_sdf, from_occupancy, from_voxels), only whose decisive grid points are evaluated with a
                graph; or a shape with oriented samples (points, splats, batches of them), whose
                winding-number field is used.
            tau: distance from the level, in units of the field, that decisive voxels must have; voxels farther than the
                field's typical change over one cell are ignored. By default half of that change.

        Returns:
            0-d tensor, or (...) with reduction "none"; at least single precision. Zero once the topology is right by
            that margin, and where no solid of the wanted topology is in reach; then there is a warning, too.
            Differentiable at fixed decisive voxels; finite for infinite and constant fields. Between
            evaluations of the whole field (see `SearchOptions.evaluate_every`) NaN gives NaN.

        Raises:
            InputError: for another kind of source, a tau that is not positive, no tau where the field has one sign, or
                a field that is found to be NaN somewhere; in volumes, NaN is background.
        """
        check_tau(tau)
        fields = self.source(source)
        batch = batch_shape(source)
        decisive = self.tracker(fields, tau)
        unreachable = [number for number, (voxels, _) in enumerate(decisive) if voxels is None]
        if unreachable:
            self._warn(unreachable, batch)
        losses = [margin_loss(field, *found) for field, found in zip(fields, decisive, strict=True)]
        return self.reduce(torch.stack(losses).reshape(batch))

    def is_met(self, solid: CountedSolid) -> bool:
        """Whether a solid has the wanted Betti numbers, and where genera were given one by one, each component too."""
        goal = self.goal
        return solid.betti == goal.betti and (not goal.by_component or solid.by_component == goal.by_component)

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def _warn(self, unreachable: list[int], batch: tuple[int, ...]) -> None:
        where = ""
        if batch:
            items = [tuple(map(int, np.unravel_index(number, batch))) for number in unreachable]
            named = ", ".join(str(item[0] if len(item) == 1 else item) for item in items)
            where = f" for batch item{'s'[: len(items) > 1]} {named}"
        warnings.warn(
            f"no solid with the Betti numbers {self.goal.betti} is in reach{where} (change={self.change!r}): the loss "
            "is 0 there. Is the grid too coarse, is there nothing yet that could become it, or does it need another "
            "change?",
            stacklevel=_caller_stacklevel(),
        )


def _new_track(goal: Goal, change: Change, search_every: int) -> SolidTrack:
    """The track of a field about which nothing is known."""
    if goal.by_component:
        return SolidTrack(ComponentGuard(goal.by_component, change, search_every), search_every)
    return SolidTrack(Guard(goal.betti, change, search_every), search_every)


def _caller_stacklevel() -> int:
    """Frames from `warnings.warn` up to the first one outside topokit and torch: the line that called the loss."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in ("topokit", "torch"):
        level, frame = level + 1, frame.f_back
    return level


def topology_loss(
    source: Source,
    genus: int | Sequence[int],
    tau: float | None = None,
    *,
    components: int = 1,
    cavities: int = 0,
    change: Change = "any",
    level: float = 0.0,
    resolution: int = 64,
    reduction: Reduction = "mean",
) -> Tensor:
    """Functional form of `TopologyLoss`. It has no memory: every call searches for the nearest solid.

    Args:
        source: field, batch of fields or shape; see `TopologyLoss.forward`.
        genus: see `TopologyLoss`.
        tau: margin; see `TopologyLoss.forward`.
        components: see `TopologyLoss`.
        cavities: see `TopologyLoss`.
        change: see `TopologyLoss`.
        level: see `TopologyLoss`.
        resolution: see `TopologyLoss`.
        reduction: see `TopologyLoss`.

    Returns:
        0-d tensor, or (...) with reduction "none".

    Raises:
        InputError: if an argument has a wrong type or value.

    Example:
        >>> import topokit as tk, torch
        >>> ring = torch.ones(5, 5, 3)
        >>> ring[2, 2] = -1.0
        >>> [bool(tk.topology_loss(ring, genus, tau=0.5) > 0) for genus in (0, 1)]
        [True, False]
    """
    loss = TopologyLoss(
        genus,
        components=components,
        cavities=cavities,
        change=change,
        level=level,
        resolution=resolution,
        reduction=reduction,
    )
    return loss(source, tau)
