"""A report as a piece of HTML: the answer, the verdict, what decided it, evidence and components."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from topokit.text import printable

if TYPE_CHECKING:
    from jinja2 import Environment

    from topokit.report.report import TopologyReport

MOST_COMPONENTS = 50  # rows of the table; a scan can have thousands of components


def report_html(report: TopologyReport) -> str:
    """The report as escaped HTML, without styles; `report_styles` has them.

    Args:
        report: any report.
    """
    shown = report.per_component[:MOST_COMPONENTS]
    return environment().get_template("report.html").render(report=report, components=shown)


def notebook_html(report: TopologyReport) -> str:
    """The report as escaped HTML with its styles, as notebooks show it."""
    return f'<style>{report_styles()}</style><div class="topokit">{report_html(report)}</div>'


@cache
def report_styles() -> str:
    """The style sheet of reports; every rule is within the class topokit."""
    return files("topokit.report").joinpath("templates", "report.css").read_text(encoding="utf-8")


@cache
def environment(package: str = "topokit.report") -> Environment:
    """The templates of a package; everything that they insert is escaped, and texts of any origin are printable."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader(package),
        autoescape=True,
        finalize=lambda value: printable(value) if type(value) is str else value,  # not what is marked as HTML
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
