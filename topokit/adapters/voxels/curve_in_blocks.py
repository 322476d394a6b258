"""The curve over the levels of a volume that is counted block by block."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from topokit.adapters.voxels.counting import Solid, values_of
from topokit.adapters.voxels.stored_volumes import StoredVolume
from topokit.core.blocks.curve import EulerCurve
from topokit.core.blocks.curve_parts import CurvePart, count_curve_part, join_curve_parts
from topokit.core.blocks.division import Box, Division, Triple
from topokit.core.blocks.gray_levels import GrayLevels
from topokit.core.blocks.on_dask import reduced
from topokit.errors import InputError


class Span(NamedTuple):
    """The lowest and the highest finite value; (∞, −∞) where there is none."""

    low: float
    high: float


@dataclass(frozen=True)
class BlockCurve:
    """The count of blocks of a volume at all levels; it is sent to workers.

    Attributes:
        solid: labels that are inside, if there are any, and connectivity.
        shape: of the volume.
        levels: of the curve.
    """

    solid: Solid
    shape: Triple
    levels: GrayLevels

    def count(self, source: Any, block: Box) -> CurvePart:
        """What is found in a block, given its values, or a function that reads them, and where it is."""
        values = values_of(source)
        gray = self.solid.mark(values)[0] if self.solid.labels else values
        ranks = self.levels.ranks(gray)
        return count_curve_part(ranks, block, self.shape, self.solid.connectivity, self.levels.n_ranks)


def curve_in_blocks(
    volume: StoredVolume, division: Division, solid: Solid, client: Any, levels: ArrayLike | int | None
) -> EulerCurve:
    """The curve of a volume, whose blocks are read once; twice if levels are to be found between its values.

    Args:
        volume: where its values are.
        division: its blocks.
        solid: labels that are inside, if there are any, and connectivity.
        client: of a Dask cluster, or None for this process, one block after the other.
        levels: as for `Shape.euler_curve`.

    Raises:
        InputError: if levels are needed, or are no ascending row.
    """
    is_number = isinstance(levels, int)
    gray = GrayLevels.all_of(bool if solid.labels else volume.dtype)
    if gray is None and levels is None:
        raise InputError(
            f"{volume.name} holds {volume.dtype} and is counted block by block; its curve needs levels. Pass levels=64 "
            "for as many between its lowest and highest value, or an ascending row of levels."
        )
    if gray is None and is_number:
        low, high = reduced(division, volume.at, _span_of_block, _joined_spans, client, Span._make)
        if low > high:
            raise InputError(f"{volume.name} has no finite values.")
        levels = np.unique(np.linspace(low, high, levels))  # type: ignore[arg-type]
    count = BlockCurve(solid, volume.shape, gray or GrayLevels.at(levels))  # type: ignore[arg-type]
    join = partial(join_curve_parts, solid.connectivity)
    curve = count.levels.curve(reduced(division, volume.at, count.count, join, client, replace).tally.curve())
    if levels is None or gray is None:
        return curve
    return curve.sampled(levels) if is_number else curve.at(levels)  # type: ignore[arg-type]


def _span_of_block(source: Any, block: Box) -> Span:
    values = values_of(source)
    finite = values[np.isfinite(values)]
    return Span(float(finite.min()), float(finite.max())) if finite.size else Span(np.inf, -np.inf)


def _joined_spans(one: Span, other: Span, axis: int) -> Span:
    return Span(min(one.low, other.low), max(one.high, other.high))
