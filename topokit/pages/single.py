"""One shape as a picture, as a page, in a notebook or in a browser's tab."""

from __future__ import annotations

import base64
import html
import os
import tempfile
import webbrowser
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from topokit.errors import TopokitError
from topokit.export.picture import EYE, Eye, picture_of
from topokit.export.scene import marks_of, scene_of
from topokit.pages.document import Entry, page_text, write_html
from topokit.pages.fragment import MAX_FACES, MAX_POINTS, PAGES, page_of, webp
from topokit.report.report import TopologyReport, environment, report_html, report_styles

if TYPE_CHECKING:
    from topokit.report.simplification import Simplification
    from topokit.shape import Shape

SIDE = 600  # pixels of a picture
_MOST_FACES = 120_000  # of the page of a single shape: about a megabyte
_MOST_POINTS = 40_000
_NOTEBOOK_SIDE = 360  # pixels of the picture, which is shown at half of that
_NOTEBOOK_HEIGHT = 560


@dataclass(frozen=True)
class View:
    """A page in a frame of a notebook."""

    page: str

    def _repr_html_(self) -> str:
        """The frame, which holds the whole page and reaches nothing outside."""
        page = html.escape(self.page, quote=True)
        return (
            f'<iframe sandbox="allow-scripts" style="width: 100%; height: {_NOTEBOOK_HEIGHT}px; border: 0" '
            f'srcdoc="{page}"></iframe>'
        )


def picture(shape: Shape, side: int = SIDE, *, eye: Eye = EYE, locate: bool = False) -> Image.Image:
    """A square picture of a shape, colored by Gaussian curvature; see `topokit.Shape.picture`."""
    marks = marks_of(shape.report(locate=True).location) if locate else ()
    scene = scene_of(shape, marks, max_faces=_MOST_FACES, max_points=_MOST_POINTS)
    return Image.fromarray(picture_of(scene, side, eye))


def save_page(shape: Shape, path: str | os.PathLike[str], before: Shape | None = None) -> None:
    """Write the page of a shape, perhaps with what it was made from; see `topokit.Shape.save_html`."""
    if before is None:
        entries = [_entry(shape)]
    else:
        entries = [
            replace(_entry(one, shape.simplification), name=f"{one.name} ({when})")
            for one, when in ((before, "before"), (shape, "after"))
        ]
    write_html(entries, path, title=shape.name)


def show(shape: Shape) -> View | None:
    """Show the page of a shape: in a notebook as the value of the cell, elsewhere in a new tab of the browser."""
    if _in_notebook():
        return View(page_text(_entry(shape), shape.name))
    path = Path(tempfile.mkdtemp(prefix="topokit-")) / "shape.html"
    save_page(shape, path)
    webbrowser.open_new_tab(path.as_uri())
    return None


def shape_html(shape: Shape, known: TopologyReport | None, *, draw: bool) -> str:
    """A small static view of a shape for notebooks; see `topokit.Shape._repr_html_`.

    Args:
        shape: any shape.
        known: its report, if that costs nothing.
        draw: whether a picture costs little.
    """
    thumbnail, problem = None, None
    if draw:
        try:
            scene = scene_of(shape, max_faces=MAX_FACES, max_points=MAX_POINTS)
            thumbnail = webp(picture_of(scene, _NOTEBOOK_SIDE))
        except TopokitError as error:
            problem = str(error)
    return (
        environment(PAGES)
        .get_template("shape.html")
        .render(
            shape=shape,
            style=report_styles(),
            report=None if known is None else report_html(known),
            thumbnail=None if thumbnail is None else base64.b64encode(thumbnail).decode("ascii"),
            side=_NOTEBOOK_SIDE // 2,
            problem=problem,
        )
    )


def _entry(shape: Shape, done: Simplification | None = None) -> Entry:
    removals = None if done is None else done.removals
    report = shape.report(locate=done is None)  # of thousands of small handles, only the removed ones are of interest
    fragment = page_of(shape, report, max_faces=_MOST_FACES, max_points=_MOST_POINTS, removals=removals)
    return Entry(shape.name, fragment)


def _in_notebook() -> bool:
    """Whether this is the kernel of a notebook."""
    try:
        from IPython import get_ipython
    except ImportError:
        return False
    shell = get_ipython()
    return shell is not None and hasattr(shell, "kernel")
