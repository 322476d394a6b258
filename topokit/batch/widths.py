"""Columns of rows about widths: what is at least so wide, and the narrowest feature of each kind."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from topokit.report.report import TopologyReport

COUNTS = ("above_pieces", "above_tunnels", "above_cavities", "above_euler", "above_genus")
NARROWEST = ("narrowest_part", "narrowest_tunnel", "narrowest_cavity")


def width_columns(features: bool | float) -> tuple[str, ...]:
    """The names of the columns that a row has besides `examine.COLUMNS`.

    Args:
        features: as for `Shape.report`: a width, True for the default one, or False if widths are not measured.
    """
    if features is False:
        return ()
    return NARROWEST if features is True else (*COUNTS, *NARROWEST)


def width_values(report: TopologyReport, features: bool | float) -> dict[str, Any]:
    """The values of these columns; None if widths could not be measured.

    The narrowest feature is that among those that were looked for, infinitely wide if there is none of its kind. It is
    unknown if no width was given and there are narrower ones than the grid could show.
    """
    values: dict[str, Any] = dict.fromkeys(width_columns(features))
    if not values or report.features is None:
        return values
    for column, narrower in zip(NARROWEST, report.features.narrower, strict=True):
        widths = (one.width for one in report.features.features if f"narrowest_{one.kind}" == column)
        values[column] = None if features is True and narrower > 0 else min(widths, default=math.inf)
    if features is not True:
        counts = report.above(features)
        values |= {column: getattr(counts, column.removeprefix("above_")) for column in COUNTS}
    return values
