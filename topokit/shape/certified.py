"""Reports of level sets whose topology is proven, or was tried to be."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from topokit.report.report import TopologyReport, counted_report

if TYPE_CHECKING:
    from topokit.shape.shape import Shape


def certified_report(shape: Shape) -> TopologyReport:
    """The report of what is proven; or that of the grids, with the places that stay open.

    Args:
        shape: made from a function.
    """
    proven = shape.certify()
    if proven.answer is not None:
        return counted_report(shape.name, shape.notes, proven.answer)
    report = shape.report()
    return replace(report, reasons=(*report.reasons, proven.statement))
