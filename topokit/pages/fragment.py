"""What a page shows of one shape, made where the shape is and small enough to be sent to another process."""

from __future__ import annotations

import gzip
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from topokit.core.arrays import Floats
from topokit.core.removal import Removal
from topokit.errors import TopokitError
from topokit.export.picture import picture_of
from topokit.export.scene import Mark, Scene, marks_of, removal_marks, scene_of
from topokit.report.report import TopologyReport, environment, report_html

if TYPE_CHECKING:
    from topokit.shape import Shape

PAGES = "topokit.pages"  # whose templates are used
MAX_FACES = 12_000  # triangles of one shape among many: about 100 kB in the page
MAX_POINTS = 12_000
_THUMBNAIL = 144  # pixels along a thumbnail; it is shown at half of that, sharp on dense screens
_QUALITY = 70  # of the WebP encoder
_MOST_PLACES = 200  # rows of the table of places; all of them are drawn
_STEPS = 65535  # of a coordinate along the longest side of the box, 16 bits
_UNKNOWN = -128  # the value of a vertex whose curvature is unknown; others are −127 … 127


@dataclass(frozen=True)
class Fragment:
    """One shape of a page: picklable, without tensors.

    Attributes:
        facts: its row in the table of a folder, by the keys of the columns; None is an empty cell.
        details: verdict, reasons, evidence, places and components as escaped HTML.
        thumbnail: a square WebP picture, or None if the shape cannot be drawn.
        scene: geometry for the 3D view, see `pack`; None if the shape cannot be drawn.
    """

    facts: dict[str, Any]
    details: str
    thumbnail: bytes | None
    scene: bytes | None

    @classmethod
    def of(cls, facts: dict[str, Any], details: str, scene: Scene | None) -> Fragment:
        """The fragment with the picture and the geometry of a scene, if there is one."""
        if scene is None:
            return cls(facts, details, None, None)
        return cls(facts, details, webp(picture_of(scene, _THUMBNAIL)), pack(scene))


def page_of(
    shape: Shape,
    report: TopologyReport,
    *,
    light: bool = False,
    max_faces: int = MAX_FACES,
    max_points: int = MAX_POINTS,
    removals: Sequence[Removal] | None = None,
) -> Fragment:
    """The part of a page that shows one shape.

    Args:
        shape: a `topokit.Shape`.
        report: its report; what `report(locate=True)` has located is drawn and listed.
        light: whether to leave out the picture and the 3D view, which take most of the time.
        max_faces: a surface with more triangles is simplified for the view, which the page says.
        max_points: of more points, these many are shown.
        removals: what was removed, or is going to be; by default what the shape says.
    """
    if removals is None:
        removals = shape.simplification.removals if shape.simplification else ()
    marks = (*marks_of(report.location), *removal_marks(removals))
    scene, note = None, "This is a light page, without pictures and 3D views." if light else None
    if not light:
        try:
            scene = scene_of(shape, marks, max_faces=max_faces, max_points=max_points)
            note = scene.note
        except TopokitError as error:
            note = f"There is no view of this shape: {error}"
    return Fragment.of(_facts(report), _details(report, marks, note), scene)


def _facts(report: TopologyReport) -> dict[str, Any]:
    names = ("verdict", "euler", "genus", "components", "boundary_loops", "pieces", "tunnels", "cavities")
    facts = {name: getattr(report, name) for name in names}
    return facts | {"closed": "yes" if report.closed else "no", "reason": "".join(report.reasons[:1])}


def _details(report: TopologyReport, marks: tuple[Mark, ...], note: str | None) -> str:
    """The text beside the 3D view: the report, the places that a click finds in the view, and a note on the view."""
    template = environment(PAGES).get_template("details.html")
    return template.render(
        report=report_html(report), marks=marks, note=note, most=_MOST_PLACES, placement=report.placement
    )


def webp(picture: NDArray[np.uint8]) -> bytes:
    """A picture (side, side, 3) as WebP."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "WEBP", quality=_QUALITY, method=4)
    return buffer.getvalue()


def pack(scene: Scene) -> bytes:
    """A scene in gzip: length of the header (4 bytes), the header as JSON, then arrays, each from a multiple of 4.

    The header holds the lowest corner and the size of the box, the limit and the legend of the colors, the marks, and
    for each array its name, type and number of values. Coordinates are 16-bit steps of the box; values of colors are
    bytes, ±127 at the limits. All numbers are little-endian.
    """
    every = np.concatenate((scene.positions, *(mark.points for mark in scene.marks)))
    low, high = every.min(axis=0), every.max(axis=0)
    size = float((high - low).max()) or 1.0
    arrays: dict[str, NDArray[Any]] = {
        "positions": _quantized(scene.positions, low, size),
        "values": _bytes(scene.values / scene.limit),
    }
    if scene.faces is None:
        arrays["normals"] = _bytes(scene.normals)
    else:
        arrays["faces"] = scene.faces.astype("<u2" if len(scene.positions) <= _STEPS else "<u4")
    if scene.marks:
        arrays["marks"] = _quantized(np.concatenate([mark.points for mark in scene.marks]), low, size)
    header = {
        "low": low.tolist(),
        "size": size,
        "limit": scene.limit,
        "legend": scene.legend,
        "marks": [{"kind": mark.kind, "form": mark.form, "points": len(mark.points)} for mark in scene.marks],
        "arrays": [[name, values.dtype.str[1:], values.size] for name, values in arrays.items()],
    }
    text = _padded(json.dumps(header).encode(), b" ")
    parts = [len(text).to_bytes(4, "little"), text, *(_padded(values.tobytes(), b"\0") for values in arrays.values())]
    return gzip.compress(b"".join(parts), compresslevel=9, mtime=0)


def _quantized(positions: Floats, low: Floats, size: float) -> NDArray[np.uint16]:
    return np.rint((positions - low) / size * _STEPS).astype("<u2")


def _bytes(values: Floats) -> NDArray[np.int8]:
    scaled = np.rint(127 * np.clip(values, -1, 1))
    return np.where(np.isfinite(scaled), scaled, _UNKNOWN).astype(np.int8)


def _padded(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % 4)
