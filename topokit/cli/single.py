"""The commands that open shapes one by one: curvature, a picture, handles, repair, all levels, tolerances."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from topokit.batch.names import name_as_data
from topokit.batch.sources import Source
from topokit.cli.answers import say
from topokit.cli.bundle import takes_bundles
from topokit.cli.options import Given, Opener
from topokit.cli.request import Format, is_same, sources_of
from topokit.errors import InputError, TopokitError
from topokit.inputs.writing import completed_file
from topokit.report.progress import progress_bar
from topokit.report.wording import plural
from topokit.text import json_text, printable

if TYPE_CHECKING:
    from topokit.shape import Shape

Quantity = Literal["gaussian", "mean", "total"]
Ways = Literal["auto", "cut", "fill", "keep"]
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
def clean(
    file: Annotated[str, typer.Argument(help="Splats (.ply, .splat or .spz).", metavar="FILE")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write, in the same format.")],
    given: Given,
    page: Annotated[
        Path | None, typer.Option("--html", help="Page to write: what is kept and what is not, in two colors.")
    ] = None,
) -> None:
    """Write the splats that are kept, as they are in the file: with --object only the object in the middle.

    Standard error says what was dropped.
    """
    opener = given.opener()

    def answer(shape: object, source: Source, is_single: bool) -> str:
        from topokit.plugins.foreign_code import answer_of, options_of
        from topokit.plugins.registry import adapter_for

        adapter, options = adapter_for(source.path, opener.adapter), opener(source.path)[1]
        options |= {} if page is None else {"page": page}
        if adapter.write_kept is None:
            raise InputError(f"{source.path}: adapter {adapter.name!r} keeps all of a file, so nothing is written.")
        if unknown := options.keys() - (options_of(adapter, "write_kept") or options).keys():
            raise InputError(f"{source.path}: {min(unknown)} is no option of what is written.")
        *dropped, kept = answer_of(adapter, "write_kept", source.path, output, **options)
        for note in dropped:
            say(f"{source.name}: {note}")
        return f"{printable(str(output))}: {kept}"

    if _ask([file], None, opener, answer, output, open_one=lambda path: path):
        raise typer.Exit(1)


@takes_bundles
def mend(
    file: Annotated[str, _SHAPE],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="File to write: a mesh of a mesh, points or splats, a volume of a volume or a network.",
        ),
    ],
    below: Annotated[float, typer.Option("--below", min=1e-300, help="Width, in units of the file.")],
    given: Given,
    format: Format = None,
    handles: Annotated[Ways, typer.Option("--handles", help="How narrow tunnels are removed.")] = "auto",
    cavities: Annotated[bool, typer.Option("--cavities/--keep-cavities", help="Remove narrow cavities.")] = True,
    parts: Annotated[bool, typer.Option("--parts/--keep-parts", help="Remove narrow parts.")] = True,
    boundaries: Annotated[bool, typer.Option("--boundaries", help="Fill the boundary of a mesh first.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object instead of the table.")] = False,
    page: Annotated[Path | None, typer.Option("--html", help="Page to write: before and after, in 3D.")] = None,
) -> None:
    """Write a shape without tunnels, cavities and parts narrower than a width, and print a table of what was removed.

    What is written has been counted. Topology that is wider stays as it is.
    """  # fmt: skip

    def answer(shape: Shape, *_: object) -> str:
        keep = False if handles == "keep" else handles
        asked = partial(shape.simplify, below=below, cavities=cavities, components=parts, boundaries=boundaries)
        made = asked(handles=keep, out=None if shape.stored is None else output)
        if shape.stored is None:
            made.save(output)
        if made.simplification is None:
            raise AssertionError(f"{made.name}: nothing says what was removed")
        say(f"{output} was written.")
        if page is not None:
            made.save_html(page, before=shape)
        return json_text(made.simplification.to_dict(), indent=2) if as_json else made.simplification.text()

    if not output.parent.is_dir():
        raise typer.BadParameter(f"-o {output}: the folder {output.parent} does not exist.")
    if _ask([file], format, given.opener(), answer, output):
        raise typer.Exit(1)


@takes_bundles
def handles(
    files: Annotated[list[str], typer.Argument(help="Files, folders and patterns.", metavar="FILE...")],
    given: Given,
    format: Format = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Loops of one file to write as lines (.ply or .glb).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON array with an object per handle.")] = False,
    most: Annotated[int, typer.Option("--most", min=0, help="A file with more handles is an error.")] = 300,
) -> None:
    """One line per handle, smallest first: lengths around the handle and around the tunnel, and the center (tabs).

    Of several files, the name follows in the same line. Standard error says how many handles each file has. Centers
    and loops are in the coordinates of the file; in JSON those of volumes are "place", as in reports.
    """
    several: list[dict[str, Any]] = []

    def answer(shape: Shape, source: Source, is_single: bool) -> str:
        from topokit.export.loops import save_loops
        from topokit.report.location import Location
        from topokit.report.report import plain
        from topokit.shape.locate import located_handles

        genus, placement = shape.report().genus or 0, shape.report().placement
        if genus > most:
            raise InputError(
                f"{source.path} has {genus} handles, more than {most}; locating so many takes minutes. Pass "
                f"--most {genus}, or remove narrow ones first (topokit mend)."
            )
        found = located_handles(shape.handles(), placement)
        in_file = tuple(one.in_file(placement) for one in found)
        say(f"{source.name}: {plural(len(found), 'handle')}.")
        if output is not None:
            save_loops(Location(in_file, (), (), ()), output)
        rows: list[dict[str, Any]] = plain(found)
        several.extend(row if is_single else {"file": name_as_data(source.name)} | row for row in rows)
        if as_json:
            return ""
        numbers = ((one.handle_length, one.tunnel_length, *one.center) for one in in_file)
        name = [] if is_single else [printable(source.name)]
        return "\n".join("\t".join([*(f"{number:.6g}" for number in line), *name]) for line in numbers)

    failed = _ask(files, format, given.opener(), answer, output, several=output is None)
    if as_json:
        typer.echo(json_text(several, indent=2))
    raise typer.Exit(int(failed))


def show_tolerances(files: list[str], format: str | None, opener: Opener, *, full: bool, as_json: bool) -> None:
    """Print the report of each mesh file, and its counts with vertices merged in several ways."""
    records: list[dict[str, Any]] = []

    def answer(shape: Shape, source: Source, is_single: bool) -> str:
        from topokit.report.report import plain
        from topokit.tolerances import tolerances

        if shape.mesh is None or isinstance(source.path, str):
            raise InputError(f"{source.path}: --tolerances is for meshes in files.")
        rows = [plain(row) for row in tolerances(source.path)]
        records.append({"file": name_as_data(source.name), "tolerances": rows})
        if as_json:
            return ""
        titles = [name.replace("_", " ").replace("nonmanifold", "non-manifold") for name in rows[0]]
        lines = [titles, *([_cell(value) for value in row.values()] for row in rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        table = ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)) for line in lines]
        return "\n".join([shape.report().text(full=full), "", *(f"  {line.rstrip()}" for line in table), ""])

    failed = _ask(files, format, opener, answer, several=True)
    if as_json:
        typer.echo(json_text(records, indent=2))
    raise typer.Exit(int(failed))


def _cell(value: object) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else "–" if value is None else str(value)


@takes_bundles
def curve(
    file: Annotated[str, typer.Argument(help="A volume, network, mesh or cloud.", metavar="FILE")],
    given: Given,
    format: Format = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Plot to write (.png, .svg or .pdf); needs matplotlib.")
    ] = None,
    n_levels: Annotated[int, typer.Option("--levels", min=0, help="Levels, at most; 0 for all changes.")] = 64,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object of lists.")] = False,
) -> None:
    """Which threshold: one line per level with χ of the solid, pieces, tunnels and cavities (tabs).

    Levels are gray values, of a mesh the distance inside its surface, of points the radius of balls around them.
    """
    opener = given.opener()

    def answer(shape: Shape, *_: object) -> str:
        from topokit.export.plot import MOST_STEPS, save_plot

        most = max(n_levels, 0 if output is None else MOST_STEPS)
        whole = shape.euler_curve(most if n_levels else None)
        if output is not None:
            save_plot(whole, output, title=shape.name)
        found = whole.sampled(n_levels) if n_levels else whole
        if as_json:
            return json_text(found.to_dict(), indent=2)
        rows = zip(found.levels, found.euler, *found.betti.T, strict=True)
        lines = (f"{level:.8g}\t" + "\t".join(map(str, numbers)) for level, *numbers in rows)
        return "\n".join(("level\teuler\tpieces\ttunnels\tcavities", *lines))

    if _ask([file], format, replace(opener, needs_level=False), answer, output):
        raise typer.Exit(1)


@takes_bundles
def surface(
    file: Annotated[str, _SHAPE],
    output: Annotated[Path, typer.Option("-o", "--output", help="Mesh to write: .stl, .ply, .obj, .off or .glb.")],
    given: Given,
    format: Format = None,
) -> None:
    """Write the surface that the report is about as a mesh, in the coordinates of the file."""

    def write(shape: Shape) -> str:
        from topokit.repair.files import save_surface

        n_vertices, n_faces = save_surface(shape, output)
        found = shape.report()
        return f"{n_vertices} vertices and {n_faces} faces, χ = {found.euler} ({found.verdict})"

    _convert(file, output, format, given.opener(), write)


def _convert(file: str, output: Path, format: str | None, opener: Opener, write: Callable[[Shape], str]) -> None:
    """Open a file, write what is made of its shape, and say so; exit code 1 if that fails.

    Args:
        file: to read; - is standard input.
        output: file to write, which must be another one.
        format: of standard input.
        opener: opens the file.
        write: writes the output, and returns what to say about it.
    """
    if _ask([file], format, opener, lambda shape, *_: f"{printable(str(output))}: {write(shape)}", output):
        raise typer.Exit(1)


def _ask(
    files: list[str],
    format: str | None,
    opener: Opener,
    answer: Callable[[Any, Source, bool], str],
    output: Path | None = None,
    *,
    several: bool = False,
    open_one: Callable[[Path | str], object] | None = None,
) -> bool:
    """Open files and print what is found out about their shapes; whether that failed for one of them.

    Args:
        files: to read; - is standard input.
        format: of standard input.
        opener: opens the files.
        answer: what to print about a shape, given its source and whether it is the only one; nothing if it is empty.
        output: file that will be written, which must be another one, or None.
        several: whether there may be several files.
        open_one: opens a path; by default the opener does.
    """
    failed, open_one = False, open_one or opener.open
    with sources_of(files, format, opener.adapter) as found:
        is_single = len(found.sources) == 1
        if not is_single and not several:
            raise typer.BadParameter(f"{', '.join(files)} stands for {len(found.sources)} files; give one.")
        names = [] if is_single or not sys.stderr.isatty() else [source.name for source in found.sources]
        with progress_bar(names, patience=0) as bar:
            for source in bar.counting(found.sources):
                try:
                    if output is not None and is_same(output, source):
                        raise InputError(f"{output} is the file to read; name another one to write.")
                    if source.problem is not None:
                        raise InputError(source.problem)
                    text, problem = answer(open_one(source.path), source, is_single), None
                except TopokitError as error:
                    error.rename(str(source.path), source.name)
                    text, problem, failed = "", opener.worded(error), True
                with bar.hidden():
                    if text:
                        typer.echo(text)
                    if problem is not None:
                        say(problem)
    return failed
