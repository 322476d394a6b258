"""The text beside a 3D view: the report, and the places that a click finds in the view."""

from __future__ import annotations

from topokit.export.scene import Mark
from topokit.report.html import environment, report_html
from topokit.report.report import TopologyReport

PAGES = "topokit.pages"  # whose templates are used
MOST_PLACES = 200  # rows of the table; all of them are drawn


def details_html(report: TopologyReport, marks: tuple[Mark, ...], note: str | None) -> str:
    """Escaped HTML of a report, of the places in its view, and of a note on the view."""
    text = report_html(report)
    return environment(PAGES).get_template("details.html").render(report=text, marks=marks, note=note, most=MOST_PLACES)
