"""The text beside a 3D view: the report, and the places that a click finds in the view."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from topokit.export.scene import Mark
from topokit.report.html import report_html
from topokit.report.report import TopologyReport

if TYPE_CHECKING:
    from jinja2 import Environment

MOST_PLACES = 200  # rows of the table; all of them are drawn


def details_html(report: TopologyReport, marks: tuple[Mark, ...], note: str | None) -> str:
    """Escaped HTML of a report, of the places in its view, and of a note on the view."""
    text = report_html(report)
    return environment().get_template("details.html").render(report=text, marks=marks, note=note, most=MOST_PLACES)


@cache
def environment() -> Environment:
    """Templates of pages; everything that they insert is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("topokit.pages")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
