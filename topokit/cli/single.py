"""The commands about one file: its curvature, a picture of it, its handles, its topology over all levels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from topokit.cli.answers import say
from topokit.cli.bundle import takes_bundles
from topokit.cli.options import Given, Opener
from topokit.cli.request import Format, is_same, sources_of
from topokit.errors import InputError, TopokitError
from topokit.inputs.writing import completed_file
from topokit.text import json_text, printable

if TYPE_CHECKING:
    from topokit.shape import Shape

Quantity = Literal["gaussian", "mean", "total"]
_SHAPE = typer.Argument(help="A mesh, points, a volume, a network or splats.", metavar="FILE")
_SUFFIXES = (".png", ".webp", ".jpg", ".jpeg")


@takes_bundles
def curvature(
    file: Annotated[str, typer.Argument(help="A mesh or a point cloud; - is standard input.", metavar="FILE")],
    output: Annotated[Path, typer.Option("-o", "--output", help="PLY file to write.")],
    given: Given,
    format: Format = None,
    color_by: Annotated[Quantity, typer.Option(help="What the colors show.")] = "gaussian",
) -> None:
    """Write curvatures as colors and scalar fields of a PLY file (a mesh stays a mesh)."""

    def write(shape: Shape) -> str:
        n_written = shape.save_ply(output, color_by)
        return f"{n_written} points with gaussian, mean, total, k_min, k_max and area"

    _convert(file, output, format, given.opener(), write)


@takes_bundles
def picture(
    file: Annotated[str, _SHAPE],
    output: Annotated[Path, typer.Option("-o", "--output", help="Picture to write (.png, .webp or .jpg).")],
    given: Given,
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
    _convert(file, output, format, given.opener(), write)


@takes_bundles
def handles(
    file: Annotated[str, _SHAPE],
    given: Given,
    format: Format = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Loops to write as lines (.ply or .glb).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON array with an object per handle.")] = False,
) -> None:
    """One line per handle, smallest first: lengths around the handle and around the tunnel, and the center (tabs)."""

    def answer(shape: Shape) -> str:
        from topokit.export.loops import save_loops
        from topokit.report.location import Location
        from topokit.report.report import plain
        from topokit.shape.locate import located_handles

        counted = shape.counted
        found = located_handles(shape.handles(), None if counted is None else counted.placement)
        if output is not None:
            save_loops(Location(found, (), (), ()), output)
        rows = plain(found)
        if as_json:
            return json_text(rows, indent=2)
        numbers = ((row["handle_length"], row["tunnel_length"], *row["center"]) for row in rows)
        return "\n".join("\t".join(f"{number:.6g}" for number in line) for line in numbers)

    _ask(file, format, given.opener(), answer, output)


@takes_bundles
def curve(
    file: Annotated[str, typer.Argument(help="A volume or a network.", metavar="FILE")],
    given: Given,
    format: Format = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Plot to write (.png, .svg or .pdf); needs matplotlib.")
    ] = None,
    n_levels: Annotated[int, typer.Option("--levels", min=0, help="Levels, evenly spaced; 0 for all changes.")] = 64,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object of lists.")] = False,
) -> None:
    """Which threshold: one line per level with χ of the solid, pieces, tunnels and cavities (tabs)."""
    opener = given.opener()

    def answer(shape: Shape) -> str:
        whole = shape.euler_curve()
        if output is not None:
            from topokit.export.plot import save_plot

            save_plot(whole, output, title=shape.name)
        found = whole.sampled(n_levels) if n_levels else whole
        if as_json:
            return json_text(found.to_dict(), indent=2)
        rows = zip(found.levels, found.euler, *found.betti.T, strict=True)
        lines = (f"{level:.8g}\t" + "\t".join(map(str, numbers)) for level, *numbers in rows)
        return "\n".join(("level\teuler\tpieces\ttunnels\tcavities", *lines))

    _ask(file, format, replace(opener, needs_level=False), answer, output)


def _convert(file: str, output: Path, format: str | None, opener: Opener, write: Callable[[Shape], str]) -> None:
    """Open a file, write what is made of its shape, and say so; exit code 1 if that fails.

    Args:
        file: to read; - is standard input.
        output: file to write, which must be another one.
        format: of standard input.
        opener: opens the file.
        write: writes the output, and returns what to say about it.
    """
    _ask(file, format, opener, lambda shape: f"{printable(str(output))}: {write(shape)}", output)


def _ask(
    file: str, format: str | None, opener: Opener, answer: Callable[[Shape], str], output: Path | None = None
) -> None:
    """Open a file and print what is found out about its shape; exit code 1 if that fails.

    Args:
        file: to read; - is standard input.
        format: of standard input.
        opener: opens the file.
        answer: what to print about the shape; nothing if it is empty.
        output: file that will be written, which must be another one, or None.
    """
    with sources_of([file], format, opener.adapter) as found:
        if len(found.sources) != 1:
            raise typer.BadParameter(f"{file} stands for {len(found.sources)} files; give one.")
        source = found.sources[0]
        try:
            if output is not None and is_same(output, source):
                raise InputError(f"{output} is the file to read; name another one to write.")
            if source.problem is not None:
                raise InputError(source.problem)
            if text := answer(opener.open(source.path)):
                typer.echo(text)
        except TopokitError as error:
            error.rename(str(source.path), source.name)
            say(opener.worded(error))
            raise typer.Exit(1) from error
