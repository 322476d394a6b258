"""Where the topology of a shape is, as lines of a scene and rows of a table."""

from __future__ import annotations

from topokit.export.loops import lines_at
from topokit.export.scene import Line
from topokit.report.report import TopologyReport


def lines_of(report: TopologyReport) -> tuple[Line, ...]:
    """Handles, tunnels, boundaries and defects that a report has located, in the order of the table."""
    return () if report.location is None else tuple(lines_at(report.location))
