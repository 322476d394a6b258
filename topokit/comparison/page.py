"""The page of a comparison: both solids in one 3D view, the counts, and every feature that only one of them has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import map_coordinates

from topokit.export.scene import Mark, Scene, simplified, view_step
from topokit.pages.document import Entry
from topokit.pages.fragment import PAGES, Fragment
from topokit.report.report import environment

if TYPE_CHECKING:
    from topokit.comparison.result import Comparison

COLUMNS = (
    ("verdict", "topology"),
    *((f"{what}{k}", f"{what} {k}") for k in range(3) for what in ("matched", "missing", "spurious")),
    *(("dice", "Dice"), ("reason", "first difference")),
)
"""Key and heading of the columns of a table of comparisons; 0, 1 and 2 are parts, tunnels and cavities."""

_MOST_FACES = 60_000  # triangles of a view: about half a megabyte
_LEGEND = ("Solid", "truth only", "both", "judged only")


def entry_of(found: Comparison, name: str) -> Entry:
    """The row of a comparison in a page, and what a click on it shows."""
    marks = tuple(Mark(one.error, one.kind, one.loop, "loop") for one in found.features if one.loop is not None)
    scene = _scene(found, marks)
    numbers = {f"{what}{k}": getattr(found, what)[k] for what in ("matched", "missing", "spurious") for k in range(3)}
    facts = numbers | {
        "verdict": "same" if found.is_same else "different",
        "dice": f"{found.solids.dice:.3f}",
        "reason": "".join(map(str, found.features[:1])),
    }
    details = environment(PAGES).get_template("comparison.html").render(found=found, note=scene and scene.note)
    return Entry(name, Fragment.of(facts, details, scene))


def _scene(found: Comparison, marks: tuple[Mark, ...]) -> Scene | None:
    """The surface of both solids together; None if they are empty."""
    from skimage.measure import marching_cubes

    pair, grid = found.solids.pair, found.solids.grid
    if pair.first.size == 0:  # the pair is in the smallest box that holds both
        return None
    step = view_step(pair.first.shape)
    first, second = (np.pad(one[::step, ::step, ::step], 1) for one in (pair.first, pair.second))
    vertices, faces, _, _ = marching_cubes((first | second).astype(np.float32), 0.5)
    vertices, faces, note = simplified(vertices.astype(np.float64), faces[:, ::-1], _MOST_FACES)
    only = first.astype(np.float32) - second  # half of it at the surface, between a voxel and the background
    values = np.clip(2 * map_coordinates(only, vertices.T, order=1), -1, 1)
    positions = np.asarray(grid.origin) + (pair.corner + (vertices - 1) * step) * grid.spacing
    return Scene(positions, np.zeros((0, 3)), values, 1.0, faces, _LEGEND, marks, note)
