"""Measurements of a report that its integer does not need."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from topokit.core.mesh.solid_by_winding import EnclosedSolid, enclosed_solid
from topokit.report.report import Evidence, TopologyReport
from topokit.report.verdict import overlaps
from topokit.shape.facts import minkowski
from topokit.shape.levels import level_range

if TYPE_CHECKING:
    from topokit.shape.shape import Shape


@torch.no_grad()
def with_details(report: TopologyReport, shape: Shape, n_neighbors: int) -> TopologyReport:
    """The report with χ⁽⁰⁾, χ⁽ᴷ⁾ (if closed) and the solid that a mesh encloses, each a row of evidence.

    Sentences state the estimates, the solid where it differs from the mesh, and at which levels a field's answer stays.

    Args:
        report: to be completed.
        shape: that the report is about.
        n_neighbors: number of neighbors for both estimates, whatever the shape's own is.
    """
    rows: list[Evidence] = []

    def timed(name: str, measure: Callable[[], Tensor]) -> float:
        started = time.perf_counter()
        value = float(measure())
        rows.append(Evidence(name, value, None, time.perf_counter() - started))
        return value

    estimate, refined = report.estimate, None
    if estimate is None:
        estimate = timed("Gauss–Bonnet", lambda: shape.gauss_bonnet(n_neighbors))
    if report.closed:
        refined = timed("Gauss–Bonnet, self-optimized", lambda: shape.refined_euler(None, n_neighbors))
    reasons = (*report.reasons, _estimate_sentence(estimate, refined))
    solid = None
    if shape.mesh is not None:
        started = time.perf_counter()
        solid = enclosed_solid(*shape.mesh)
        seconds = time.perf_counter() - started
        rows.append(Evidence("solid by winding number", float(solid.euler), solid.euler, seconds))
        if not report.closed or overlaps(solid.off_level) or solid.euler != report.euler:
            reasons = (*reasons, _solid_sentence(solid, report.closed))
    if (levels := level_range(shape)) is not None:
        reasons = (
            *reasons,
            f"Pieces, tunnels and cavities stay the same at levels from {levels[0]:.6g} to {levels[1]:.6g}.",
        )
    return replace(
        report,
        reasons=reasons,
        evidence=(*report.evidence, *rows),
        estimate=estimate,
        refined=refined,
        solid=solid,
        level_range=levels,
        minkowski=None if shape.field is None and report.minkowski is None else minkowski(shape),
    )


def _estimate_sentence(estimate: float, refined: float | None) -> str:
    after = "" if refined is None else f", {refined:.3f} after self-optimization"
    return f"Gauss–Bonnet estimates χ ≈ {estimate:.3f}{after}."


def _solid_sentence(solid: EnclosedSolid, closed: bool) -> str:
    surface = (
        f"On a grid of step {solid.cell:.3g}, the solid that the mesh encloses by winding number has a surface with"
    )
    if not closed:
        return f"{surface} χ = {solid.euler}."
    if not overlaps(solid.off_level):
        return f"{surface} χ = {solid.euler}: parts of the mesh overlap, or features are narrower than two steps."
    return (
        f"{surface} χ = {solid.euler}; {solid.off_level:.0%} of the area lies off that surface: the mesh intersects or "
        "overlaps itself."
    )
