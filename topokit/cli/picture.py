"""The command that draws a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from topokit.cli.options import Opener, opens_files
from topokit.cli.request import Format
from topokit.cli.single import convert
from topokit.inputs.writing import completed_file

if TYPE_CHECKING:
    from topokit.shape import Shape

_SUFFIXES = (".png", ".webp", ".jpg", ".jpeg")


@opens_files
def picture(
    file: Annotated[str, typer.Argument(help="A mesh, points, a volume, a network or splats.", metavar="FILE")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Picture to write (.png, .webp or .jpg).")],
    opener: Opener,
    format: Format = None,
    side: Annotated[int, typer.Option("--side", min=16, max=4096, help="Pixels along the square.")] = 600,
    eye: Annotated[
        tuple[float, float, float], typer.Option("--eye", help="Direction from the shape to the viewer; z is up.")
    ] = (0.9, -1.3, 1.0),
    locate: Annotated[bool, typer.Option("--locate", help="Draw handles, boundaries and defects as lines.")] = False,
) -> None:
    """Draw a file, colored by Gaussian curvature; no display is needed."""

    def write(shape: Shape) -> str:
        drawn = shape.picture(side, eye=eye, locate=locate)
        with completed_file(output) as unfinished:
            drawn.save(unfinished)
        return f"{side} x {side} pixels"

    if output.suffix.lower() not in _SUFFIXES:
        raise typer.BadParameter(f"-o {output}: a picture must be called {', '.join(_SUFFIXES)}.")
    if not output.parent.is_dir():
        raise typer.BadParameter(f"-o {output}: the folder {output.parent} does not exist.")
    convert(file, output, format, opener, write)
