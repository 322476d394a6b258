"""What a page shows of one shape, made where the shape is and small enough to be sent to another process."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from topokit.errors import TopokitError
from topokit.export.picture import picture_of
from topokit.export.scene import Drawable, scene_of
from topokit.pages.details import details_html
from topokit.pages.geometry import pack
from topokit.pages.marks import marks_of
from topokit.report.report import TopologyReport

MAX_FACES = 12_000  # triangles of one shape among many: about 100 kB in the page
MAX_POINTS = 12_000
_THUMBNAIL = 144  # pixels along a thumbnail; it is shown at half of that, sharp on dense screens
_QUALITY = 70  # of the WebP encoder


@dataclass(frozen=True)
class Facts:
    """The columns of a folder's table for one shape; None is an empty cell.

    Attributes:
        verdict: "certain", "likely" or "unsure".
        euler: Euler characteristic of the surface.
        genus: handles summed over components.
        components: connected components of the surface.
        boundary_loops: closed boundary curves.
        closed: whether the surface is closed.
        reason: the reason that decided the verdict.
    """

    verdict: str
    euler: int | None
    genus: int | None
    components: int
    boundary_loops: int | None
    closed: bool
    reason: str


@dataclass(frozen=True)
class Fragment:
    """One shape of a page: picklable, without tensors.

    Attributes:
        facts: its row in the table of a folder.
        details: verdict, reasons, evidence, places and components as escaped HTML.
        thumbnail: a square WebP picture, or None if the shape cannot be drawn.
        scene: geometry for the 3D view, see `topokit.pages.geometry.pack`; None if the shape cannot be drawn.
    """

    facts: Facts
    details: str
    thumbnail: bytes | None
    scene: bytes | None


def page_of(
    shape: Drawable, report: TopologyReport, *, max_faces: int = MAX_FACES, max_points: int = MAX_POINTS
) -> Fragment:
    """The part of a page that shows one shape.

    Args:
        shape: a `topokit.Shape`.
        report: its report; what `report(locate=True)` has located is drawn and listed.
        max_faces: a surface with more triangles is simplified for the view, which the page says.
        max_points: of more points, these many are shown.
    """
    marks = marks_of(report.location)
    scene, problem = None, None
    try:
        scene = scene_of(shape, marks, max_faces=max_faces, max_points=max_points)
    except TopokitError as error:
        problem = f"There is no view of this shape: {error}"
    note = problem if scene is None else scene.note
    return Fragment(
        facts=_facts(report),
        details=details_html(report, marks, note),
        thumbnail=None if scene is None else webp(picture_of(scene, _THUMBNAIL)),
        scene=None if scene is None else pack(scene),
    )


def _facts(report: TopologyReport) -> Facts:
    return Facts(
        verdict=report.verdict,
        euler=report.euler,
        genus=report.genus,
        components=report.components,
        boundary_loops=report.boundary_loops,
        closed=report.closed,
        reason=report.reasons[0] if report.reasons else "",
    )


def webp(picture: NDArray[np.uint8]) -> bytes:
    """A picture (side, side, 3) as WebP."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "WEBP", quality=_QUALITY, method=4)
    return buffer.getvalue()
