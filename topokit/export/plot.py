"""Curves over levels as a plot, drawn by matplotlib without a display."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from topokit.errors import InputError, requiring
from topokit.inputs.writing import completed_file

if TYPE_CHECKING:
    from topokit.core.blocks.curve import EulerCurve

SUFFIXES = (".png", ".svg", ".pdf")
MOST_STEPS = 5000  # that are drawn one by one


def save_plot(curve: EulerCurve, path: str | os.PathLike[str], *, title: str = "") -> None:
    """Write pieces, tunnels, cavities and χ over the level as a plot of two panels.

    Args:
        curve: of `shape.euler_curve()`.
        path: file to write (.png, .svg or .pdf).
        title: above the plot.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
        InputError: if the file has another suffix, its folder does not exist, or the curve has no levels.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise InputError(f"{target}: a plot must be called {', '.join(SUFFIXES)}.")
    if not target.parent.is_dir():
        raise InputError(f"{target}: the folder {target.parent} does not exist.")
    if len(curve.levels) == 0:
        raise InputError(f"{target}: the curve has no levels to draw.")
    with requiring('Drawing a plot needs matplotlib: pip install "topokit[plots]".'):
        from matplotlib.figure import Figure
    curve = curve.sampled(MOST_STEPS)
    figure = Figure(figsize=(8, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for number, name in enumerate(("pieces", "tunnels", "cavities")):
        upper.step(curve.levels, curve.betti[:, number], where="post", label=name)
    upper.set_yscale("symlog", linthresh=1)
    upper.set_ylim(bottom=0)
    upper.legend()
    lower.step(curve.levels, curve.euler, where="post", color="black")
    lower.set_yscale("symlog", linthresh=1)
    lower.set_ylabel("χ of the solid")
    lower.set_xlabel(curve.over)
    figure.suptitle(title)
    with completed_file(target) as unfinished:
        figure.savefig(unfinished, format=target.suffix[1:].lower(), dpi=120)
