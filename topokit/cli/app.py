"""The command line: results on stdout, everything else on stderr; exit 0, 1 (some file failed) or 2 (usage)."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from topokit.cli.answers import Answer, answer_each
from topokit.cli.options import Opener, opens_files
from topokit.cli.picture import picture
from topokit.errors import AdapterWarning, InputError

app = typer.Typer(
    help="Curvature, Euler characteristic and genus of meshes, points, volumes, networks and splats.",
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Files = Annotated[list[Path], typer.Argument(help="Meshes, points, volumes, networks or splats.", metavar="FILE...")]
Json = Annotated[bool, typer.Option("--json", help="One JSON array, an object per file.")]
Quantity = Literal["gaussian", "mean", "total"]


def _print_version(wanted: bool) -> None:
    if wanted:
        from topokit import __version__

        typer.echo(f"topokit {__version__}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Print warnings about plug-ins like the other messages of this command."""

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, AdapterWarning):
            typer.echo(f"topokit: {message}", err=True)
        else:
            usual(message, category, *where, **more)

    usual, warnings.showwarning = warnings.showwarning, show


@app.command()
@opens_files
def report(
    files: Files,
    opener: Opener,
    as_json: Json = False,
    details: Annotated[
        bool, typer.Option("--details", help="Also estimates from curvature; this takes longer.")
    ] = False,
) -> None:
    """Euler characteristic, genus, components, closedness and how far to believe them."""

    def answer(path: Path) -> Answer:
        found = opener(path).report(details=details)
        return found.to_dict(), f"{found}\n"

    answer_each(files, answer, as_json)


@app.command()
@opens_files
def euler(files: Files, opener: Opener, as_json: Json = False) -> None:
    """One line per file: Euler characteristic, verdict, file (separated by tabs)."""

    def answer(path: Path) -> Answer:
        found = opener(path).report()
        if found.euler is None:
            raise InputError(f"{path}: the Euler characteristic is unknown. {' '.join(found.reasons)}")
        return {"euler": found.euler, "verdict": found.verdict}, f"{found.euler}\t{found.verdict}\t{path}"

    answer_each(files, answer, as_json)


@app.command()
@opens_files
def genus(files: Files, opener: Opener, as_json: Json = False) -> None:
    """One line per file: genus, verdict, file (separated by tabs)."""

    def answer(path: Path) -> Answer:
        from topokit.report.report import known_genus

        found = opener(path).report()
        handles = known_genus(found)
        return {"genus": handles, "verdict": found.verdict}, f"{handles}\t{found.verdict}\t{path}"

    answer_each(files, answer, as_json)


@app.command()
@opens_files
def curvature(
    file: Annotated[Path, typer.Argument(help="A mesh or a point cloud.", metavar="FILE")],
    output: Annotated[Path, typer.Option("-o", "--output", help="PLY file to write.")],
    opener: Opener,
    color_by: Annotated[Quantity, typer.Option(help="What the colors show.")] = "gaussian",
) -> None:
    """Write curvatures as colors and scalar fields of a PLY file (a mesh stays a mesh)."""

    def answer(path: Path) -> Answer:
        from topokit.export.ply import save_ply

        if output.exists() and output.samefile(path):
            raise InputError(f"{output} is the file to read; name another one to write.")
        n_written = save_ply(opener(path), output, color_by)
        return {}, f"{output}: {n_written} points with gaussian, mean, total, k_min, k_max and area"

    answer_each([file], answer)


app.command()(picture)


@app.command()
def adapters(as_json: Annotated[bool, typer.Option("--json", help="One object per adapter.")] = False) -> None:
    """What can be opened: one line per adapter with name, suffixes, and "usable" or what is missing (tabs between)."""
    from topokit.plugins.registry import list_adapters

    shown = ("name", "description", "suffixes", "types", "usable", "missing_suffixes", "install", "problem")
    if as_json:
        rows = [{key: getattr(adapter, key) for key in shown} for adapter in list_adapters()]
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    for adapter in list_adapters():
        typer.echo(f"{adapter.name}\t{' '.join(adapter.suffixes) or '-'}\t{adapter.state}")


@app.command()
def demo() -> None:
    """The reports of shapes that topokit makes itself."""
    import topokit as tk
    from topokit.testing import genus_mesh, torus_samples

    mesh, cloud = tk.from_mesh(genus_mesh(3)), tk.from_points(torus_samples(10_000).points)
    typer.echo(f"{mesh.replace(name='a genus-3 mesh').report()}\n")
    typer.echo(f"{cloud.replace(name='a torus as an unoriented point cloud').report()}\n")
