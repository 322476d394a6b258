"""The command line: results on stdout, everything else on stderr; exit 0, 1 (some file failed) or 2 (usage)."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from topokit.errors import AdapterWarning, InputError, TopokitError

if TYPE_CHECKING:
    from topokit.report.report import TopologyReport
    from topokit.shape import Shape

app = typer.Typer(
    help="Curvature, Euler characteristic and genus of meshes, points, volumes, networks and splats.",
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Files = Annotated[list[Path], typer.Argument(help="Meshes, points, volumes, networks or splats.", metavar="FILE...")]
Neighbors = Annotated[int, typer.Option("-k", "--neighbors", min=3, help="Neighbours of each point.")]
Samples = Annotated[int, typer.Option("--samples", min=4, help="Points sampled from a mesh.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of the sampling.")]
Answer = TypeVar("Answer")
Quantity = Literal["gaussian", "mean", "total"]


@app.callback()
def main() -> None:
    """Warnings about plug-ins look like the other messages of this command."""

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, AdapterWarning):
            typer.echo(f"topokit: {message}", err=True)
        else:
            usual(message, category, *where, **more)

    usual, warnings.showwarning = warnings.showwarning, show


@app.command()
def report(
    files: Files,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON array, an object per file.")] = False,
    neighbors: Neighbors = 20,
    samples: Samples = 10_000,
    seed: Seed = 0,
) -> None:
    """Euler characteristic, genus, components, closedness and how far to believe them."""

    def answer(path: Path) -> TopologyReport:
        return _open(path, neighbors, samples, seed).report()

    rows: list[dict[str, Any]] = []
    failed = False
    for path, found in _each(files, answer):
        failed |= isinstance(found, TopokitError)
        if isinstance(found, TopokitError):
            rows.append({"file": str(path), "error": str(found)})
        else:
            rows.append({"file": str(path), **found.to_dict()})
            if not as_json:
                typer.echo(f"{found}\n")
    if as_json:
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False, allow_nan=False))
    raise typer.Exit(int(failed))


@app.command()
def euler(files: Files, neighbors: Neighbors = 20, samples: Samples = 10_000, seed: Seed = 0) -> None:
    """One line per file: Euler characteristic, verdict, file (separated by tabs)."""

    def answer(path: Path) -> str:
        found = _open(path, neighbors, samples, seed).report()
        if found.euler is None:
            raise InputError(f"{path}: there is nothing to go by. {' '.join(found.reasons)}")
        return f"{found.euler}\t{found.verdict}\t{path}"

    _print_each(files, answer)


@app.command()
def genus(files: Files, neighbors: Neighbors = 20, samples: Samples = 10_000, seed: Seed = 0) -> None:
    """One line per file: genus, verdict, file (separated by tabs)."""

    def answer(path: Path) -> str:
        from topokit.report.report import known_genus

        found = _open(path, neighbors, samples, seed).report()
        return f"{known_genus(found)}\t{found.verdict}\t{path}"

    _print_each(files, answer)


@app.command()
def curvature(
    file: Annotated[Path, typer.Argument(help="A mesh or a point cloud.", metavar="FILE")],
    output: Annotated[Path, typer.Option("-o", "--output", help="PLY file to write.")],
    color_by: Annotated[Quantity, typer.Option(help="What the colours show.")] = "gaussian",
    neighbors: Neighbors = 20,
    samples: Samples = 10_000,
    seed: Seed = 0,
) -> None:
    """Write curvatures as colours and scalar fields of a PLY file (a mesh stays a mesh)."""

    def answer(path: Path) -> str:
        from topokit.export.ply import save_ply

        if output.exists() and output.samefile(path):
            raise InputError(f"{output} is the file to read; name another one to write.")
        n_written = save_ply(_open(path, neighbors, samples, seed), output, color_by)
        return f"{output}: {n_written} points with gaussian, mean, total, k_min, k_max and area"

    _print_each([file], answer)


@app.command()
def adapters(
    as_json: Annotated[bool, typer.Option("--json", help="One JSON array, an object per adapter.")] = False,
) -> None:
    """What can be opened: one line per adapter with name, suffixes, and "usable" or what is missing (tabs between)."""
    from dataclasses import asdict

    from topokit.plugins.registry import list_adapters

    if as_json:
        typer.echo(json.dumps([asdict(info) for info in list_adapters()], indent=2, ensure_ascii=False))
        return
    for info in list_adapters():
        typer.echo(f"{info.name}\t{' '.join(info.suffixes) or '-'}\t{info.state}")


@app.command()
def demo() -> None:
    """The report of shapes that topokit makes itself."""
    import topokit as tk
    from topokit.testing import genus_mesh, torus_samples

    points = torus_samples(10_000).points
    for name, shape in (
        ("a genus-3 mesh", tk.from_mesh(genus_mesh(3))),
        ("a torus as an unoriented point cloud", tk.from_points(points)),
    ):
        shape.name = name
        typer.echo(f"{shape.report()}\n")


def _open(path: Path, n_neighbors: int, n_samples: int, seed: int) -> Shape:
    import torch

    from topokit.plugins.registry import load_with

    generator = torch.Generator().manual_seed(seed)
    return load_with(path, {"n_neighbors": n_neighbors, "n_samples": n_samples, "generator": generator})


def _print_each(files: list[Path], answer: Callable[[Path], str]) -> None:
    failed = False
    for _, found in _each(files, answer):
        failed |= isinstance(found, TopokitError)
        if not isinstance(found, TopokitError):
            typer.echo(found)
    raise typer.Exit(int(failed))


def _each(files: list[Path], answer: Callable[[Path], Answer]) -> Iterator[tuple[Path, Answer | TopokitError]]:
    """Answers file by file; a file that fails is reported on stderr and the others go on."""
    with _progress(len(files)) as advance:
        for path in files:
            try:
                yield path, answer(path)
            except TopokitError as error:
                typer.echo(f"topokit: {error}", err=True)
                yield path, error
            advance()


@contextmanager
def _progress(n_files: int) -> Iterator[Callable[[], None]]:
    """A bar on stderr where that is a terminal and there is more than one file."""
    if n_files < 2 or not sys.stderr.isatty():
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("files", total=n_files)
        yield lambda: bar.advance(task)
