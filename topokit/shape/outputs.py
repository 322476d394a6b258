"""A shape for the eye: pictures, pages, notebooks, and files with curvature as colors.

The functions are methods of `Shape`.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import trimesh
    from PIL import Image

    from topokit.export.colors import Quantity
    from topokit.pages.single import View
    from topokit.shape.shape import Shape


def to_trimesh(shape: Shape, color_by: Quantity | None = None) -> trimesh.Trimesh:
    """The mesh as a `trimesh.Trimesh`, with the vertices that were counted as one merged.

    Args:
        color_by: "gaussian", "mean" or "total" adds curvature as vertex colors and attributes (see
            `topokit.export.to_trimesh`) and leaves out vertices without a face; None leaves the mesh bare.

    Raises:
        InputError: if the shape was not made from a mesh.
    """
    from topokit.export.trimesh import to_trimesh

    return to_trimesh(shape, color_by)


def save_ply(shape: Shape, path: str | os.PathLike[str], color_by: Quantity = "gaussian") -> int:
    """Write curvature as colors and scalar fields of a PLY file; see `topokit.export.save_ply`."""
    from topokit.export.ply import save_ply

    return save_ply(shape, path, color_by)


def picture(
    shape: Shape, side: int = 600, *, eye: tuple[float, float, float] = (0.9, -1.3, 1.0), locate: bool = False
) -> Image.Image:
    """A picture of the shape, colored by Gaussian curvature, made on the CPU without a display.

    A mesh is drawn as it is, a volume or network as its level set, anything else as its samples.

    Args:
        side: pixels of the square.
        eye: direction from the shape to the viewer; z is up.
        locate: whether to draw the handles, tunnels, boundaries and defects of the report as lines.

    Raises:
        InputError: if the samples are batched.
    """
    from topokit.pages.single import picture

    return picture(shape, side, eye=eye, locate=locate)


def save_html(shape: Shape, path: str | os.PathLike[str], *, before: Shape | None = None) -> None:
    """Write the report with a 3D view as one HTML file that needs nothing else.

    Where narrow features were removed, the view marks the places, and the page lists them.

    Args:
        path: file to write, called .html or .htm; it appears when it is complete.
        before: what the shape was made from, by `simplify` or otherwise: the page shows both.

    Raises:
        InputError: if the file is not called .html or .htm, or its folder does not exist; or if the samples are
            batched.
    """
    from topokit.pages.single import save_page

    save_page(shape, path, before)


def show(shape: Shape) -> View | None:
    """Show the page that `save_html` writes: in a notebook below the cell, elsewhere in a tab of the browser."""
    from topokit.pages.single import show

    return show(shape)


def notebook_html(shape: Shape) -> str:
    """What a notebook shows: a picture and the report, as far as neither takes long to make."""
    from topokit.pages.single import shape_html

    report = None if shape._known.counted_so_far is None else shape.report()
    return shape_html(shape, report, draw=report is not None or shape._known.samples_so_far is not None)
