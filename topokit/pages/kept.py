"""The page of a scene of which a part was kept: kept and removed points in two colors, and a sentence for each step."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from topokit.core.arrays import Booleans, Floats
from topokit.export.scene import points_scene
from topokit.pages.document import Entry, write_html
from topokit.pages.fragment import PAGES, Fragment
from topokit.report.report import environment

_MOST_POINTS = 60_000  # of a view: about half a megabyte
_LEGEND = ("Points", "kept", "", "removed")
_COLUMNS = (("points", "points"), ("kept", "kept"))


def save_kept_page(
    path: str | os.PathLike[str],
    name: str,
    positions: Floats,
    normals: Floats,
    is_kept: Booleans,
    notes: Sequence[str],
) -> None:
    """Write the page of a scene of which a part was kept.

    Args:
        path: file to write, called .html or .htm; it appears when it is complete.
        name: of the scene.
        positions: (N, 3), finite.
        normals: (N, 3), unit, by which points are shaded.
        is_kept: (N,).
        notes: what was done, step by step.

    Raises:
        InputError: if the file is not called .html or .htm, or its folder does not exist.
    """
    scene = points_scene(positions, normals, np.where(is_kept, -1.0, 1.0), 1.0, _LEGEND, max_points=_MOST_POINTS)
    notes = (*notes, scene.note) if scene.note else notes
    facts = {"points": len(positions), "kept": int(is_kept.sum()), "verdict": "kept"}
    details = environment(PAGES).get_template("kept.html").render(notes=notes)
    write_html([Entry(name, Fragment.of(facts, details, scene))], path, title=name, columns=_COLUMNS)
