"""How far an answer may be believed: one rule per kind of evidence, and every threshold that decides."""

from __future__ import annotations

from typing import Literal

Verdict = Literal["certain", "likely", "unsure"]


def mesh_verdict(is_closed: bool, exact_vertices: bool) -> Verdict:
    """A closed manifold mesh is proven by counting, unless it is closed only after a merge of nearly equal vertices."""
    if not is_closed:
        return "unsure"
    return "certain" if exact_vertices else "likely"


def volume_verdict() -> Verdict:
    """A binary volume is proven by counting, under its stated connectivity."""
    return "certain"


def function_verdict(is_converged: bool, *, reaches_box: bool, adds_up: bool) -> Verdict:
    """A level set is likely once refinement changes nothing; no grid proves what lies between its points.

    Args:
        is_converged: whether both connectivities, successive grids and shifted levels agree.
        reaches_box: whether the level set is cut by the box.
        adds_up: whether the surfaces of the grid that was kept sum to the integer.
    """
    return "likely" if is_converged and adds_up and not reaches_box else "unsure"
