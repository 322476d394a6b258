"""The command line: results on stdout, everything else on stderr.

Exit codes: 0 if all files answered; 1 if some file failed, or a condition of --fail-on was met; 2 for wrong usage; 130
after an interrupt, 143 after SIGTERM.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TextIO

import typer

from topokit.batch.examine import COLUMNS, Answer, called
from topokit.batch.journal import Journal, plain_options, stamps_of
from topokit.batch.names import distinguishing_names, name_as_data
from topokit.batch.sources import Sources
from topokit.batch.widths import width_columns
from topokit.cli.answers import answer_files, say
from topokit.cli.bundle import takes_bundles
from topokit.cli.comparing import compare
from topokit.cli.encoding import PrintableErrors, use_encodable_letters
from topokit.cli.options import Given, Opener, described_options
from topokit.cli.request import Output, Request, Resume
from topokit.cli.single import clean, curvature, curve, handles, mend, picture, show_tolerances, surface
from topokit.cli.writers import (
    CsvWriter,
    Form,
    Forms,
    JsonForms,
    JsonLinesWriter,
    JsonWriter,
    TableWriter,
    TextWriter,
    Writer,
)
from topokit.errors import AdapterWarning
from topokit.text import make_logs_printable, printable, printable_lines

if TYPE_CHECKING:
    from topokit.report.report import TopologyReport

app = typer.Typer(
    cls=PrintableErrors,
    help="Curvature, Euler characteristic and genus of meshes, points, volumes, networks and splats.",
    epilog="Exit codes: 0 all files answered; 1 a file failed, or --fail-on was met; 2 wrong usage; 130 interrupted.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)

_WHAT = "Files, folders, patterns such as 'parts/**/*.stl', addresses as https://…, or - for standard input."
Files = Annotated[list[str], typer.Argument(help=_WHAT, metavar="FILE...")]


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
    """Print warnings about plug-ins like the other messages of this command, all in letters that can be printed."""

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, AdapterWarning):
            say(str(message))
        else:
            usual(printable_lines(str(message)), category, *where, **more)

    use_encodable_letters()
    make_logs_printable()
    usual, warnings.showwarning = warnings.showwarning, show


@app.command()
@takes_bundles
def report(
    files: Files,
    forms: Forms,
    request: Request,
    given: Given,
    details: Annotated[
        bool, typer.Option("--details", help="Also estimates from curvature; this takes longer.")
    ] = False,
    locate: Annotated[
        bool, typer.Option("--locate", help="Also where handles, boundaries and defects are; this takes longer.")
    ] = False,
    certify: Annotated[
        bool | None,
        typer.Option(
            "--certify/--no-certify",
            help="Prove the level sets of networks, for up to a minute each; or not even where that is cheap.",
        ),
    ] = None,
    features: Annotated[
        bool, typer.Option("--features", help="Also how wide parts, tunnels and cavities are; this takes longer.")
    ] = False,
    above: Annotated[
        float | None,
        typer.Option(metavar="WIDTH", min=1e-300, help="The same for those at least so wide, in units of the file."),
    ] = None,
    output: Output = None,
    resume: Resume = False,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="With --resume: examine those files again that failed.")
    ] = False,
    html: Annotated[
        Path | None, typer.Option("--html", help="Also write one HTML file with a 3D view of every shape.")
    ] = None,
    tolerances: Annotated[
        bool, typer.Option("--tolerances", help="Also the counts of a mesh file under several weldings and formats.")
    ] = False,
    light: Annotated[
        bool, typer.Option("--light", help="With --html: no pictures and 3D views, for thousands of files.")
    ] = False,
) -> None:
    """Euler characteristic, genus, components, closedness and how far to believe them."""
    above_width = above or features
    asked = {"details": details, "locate": locate, "certify": certify, "features": above_width}
    if tolerances:
        if forms.chosen not in (None, "text", "json") or html or output or any(asked.values()) or request.conditions:
            raise typer.BadParameter("--tolerances goes with --text, --json and -v only.")
        full, as_json = request.verbose, forms.chosen == "json"
        show_tolerances(files, request.format, given.opener(), full=full, as_json=as_json)
    opener, form, labels = given.opener(), forms.chosen, request.chosen_labels
    if resume and (output is None or form != "jsonl" or html is not None or request.conditions):
        raise typer.BadParameter("--resume goes with -o and --jsonl, and without --html and --fail-on.")
    if retry_failed and not resume:
        raise typer.BadParameter("--retry-failed goes with --resume.")
    if light and html is None:
        raise typer.BadParameter("--light goes with --html.")
    options = plain_options(opener.adapter, opener.given, labels=labels, **asked)
    lines = Journal(output or Path(), options, several=labels is not None, retries=retry_failed)
    widths = width_columns(above_width)

    def record(answer: Answer) -> dict[str, Any]:
        from topokit.report.report import plain

        if answer.report is None:
            return _named(answer) | {"error": answer.error}
        return _named(answer) | answer.report.to_dict() | {name: plain(answer.row[name]) for name in widths}

    def writer(stream: TextIO, found: Sources) -> Writer:
        several = len(found.sources) > 1 or labels is not None
        chosen = form or ("table" if several and stream.isatty() else "text")
        if chosen == "json":
            return JsonWriter(stream, record)
        if chosen == "jsonl":
            stamps = {} if output is None else stamps_of(found.sources)
            return JsonLinesWriter(stream, lambda it: lines.record(record(it), stamps.get(it.row["file"])))
        if chosen == "csv":
            return CsvWriter(stream, (*COLUMNS, *widths))
        if chosen == "table":
            return TableWriter(stream, [f"{source.name}{_longest_label(labels)}" for source in found.sources], widths)
        names = distinguishing_names(found.sources)
        full = request.verbose or details

        def text(answer: Answer) -> str:
            told_apart = _told_apart(answer, names)
            return "" if told_apart is None else f"{told_apart.text(full=full)}\n"

        return TextWriter(stream, text)

    needs_report = form not in ("csv", "table")
    answer_files(
        files,
        opener,
        request,
        writer,
        asked=asked | {"locate": locate or (html is not None and not light)},
        with_report=needs_report,
        output=output,
        resume=lines if resume else None,
        html=html,
        light=light,
    )


@app.command()
@takes_bundles
def euler(files: Files, forms: JsonForms, request: Request, given: Given) -> None:
    """One line per shape: Euler characteristic, verdict, file (separated by tabs)."""
    _print_number("euler", "the Euler characteristic is unknown", files, given.opener(), request, forms.chosen)


@app.command()
@takes_bundles
def genus(files: Files, forms: JsonForms, request: Request, given: Given) -> None:
    """One line per shape: genus, verdict, file (separated by tabs)."""
    _print_number("genus", "genus is undefined or unknown", files, given.opener(), request, forms.chosen)


def _print_number(
    name: str, missing: str, files: list[str], opener: Opener, request: Request, form: Form | None
) -> None:
    """One number of every report; where it is None, that is an error."""

    def check(answer: Answer) -> Answer:
        from topokit.report.report import why

        if answer.row[name] is not None or answer.report is None:
            return answer
        error = f"{called(answer.row)}: {missing}. {why(answer.report)}"
        named = {name: answer.row[name] for name in ("file", "label")}
        return Answer(dict.fromkeys(COLUMNS) | named | {"error": error})

    def record(answer: Answer) -> dict[str, Any]:
        row = answer.row
        found = {name: row[name], "verdict": row["verdict"]} if answer.error is None else {"error": answer.error}
        return _named(answer) | found

    def writer(stream: TextIO, found: Sources) -> Writer:
        if form is None:
            return TextWriter(stream, lambda it: f"{it.row[name]}\t{it.row['verdict']}\t{printable(called(it.row))}")
        return (JsonWriter if form == "json" else JsonLinesWriter)(stream, record)

    answer_files(files, opener, request, writer, check=check)


for command in (clean, compare, curvature, picture, surface, handles, mend, curve):
    app.command()(command)


@app.command()
def adapters(
    name: Annotated[str | None, typer.Argument(help="An adapter, for its options.", metavar="[NAME]")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One object per adapter, or per option.")] = False,
) -> None:
    """What can be opened: one line per adapter with name, suffixes, and "usable" or what is missing (tabs between).

    With a NAME, the options of that adapter: one line per option with its default and what it expects.
    """
    from topokit.plugins.registry import list_adapters

    if name is not None:
        if name not in (known := [one.name for one in list_adapters()]):
            raise typer.BadParameter(f"{name!r} is no adapter; expected {' or '.join(known)}.")
        rows = described_options(name)
        lines = [f"{row['option']}\t{row['default']}\t{row['expected']}" for row in rows]
    else:
        shown = ("name", "description", "suffixes", "types", "usable", "missing_suffixes", "install", "problem")
        rows = [{key: getattr(adapter, key) for key in shown} for adapter in list_adapters()]
        lines = [f"{one.name}\t{' '.join(one.suffixes) or '-'}\t{one.state}" for one in list_adapters()]
    typer.echo(json.dumps(rows, indent=2) if as_json else "\n".join(lines))


@app.command()
def mcp() -> None:
    """A server for agents (Model Context Protocol, standard input and output): report, handles, mend, compare."""
    from topokit.cli.agents import make_server
    from topokit.errors import MissingDependencyError

    try:
        server = make_server()
    except MissingDependencyError as error:
        say(str(error))
        raise typer.Exit(1) from error
    server.run()


@app.command()
def demo() -> None:
    """The reports of shapes that topokit makes itself."""
    import topokit as tk
    from topokit.testing import genus_mesh, torus_samples

    mesh, cloud = tk.from_mesh(genus_mesh(3)), tk.from_points(torus_samples(10_000).points)
    typer.echo(f"{mesh.replace(name='a genus-3 mesh').report()}\n")
    typer.echo(f"{cloud.replace(name='a torus as an unoriented point cloud').report()}\n")


def _longest_label(labels: Literal["all"] | Sequence[int] | None) -> str:
    """What comes behind the name of a file at most; "all" labels are known only later, and seldom have six digits."""
    if labels is None:
        return ""
    return max((f", label {label}" for label in ([99_999] if labels == "all" else labels)), key=len)


def _told_apart(answer: Answer, names: Mapping[str, str]) -> TopologyReport | None:
    """The report of an answer, named by more than the file's name if another file has that, too."""
    file = answer.row["file"]
    if answer.report is None or names[file] == Path(file).name:
        return answer.report
    return replace(answer.report, name=called(answer.row | {"file": names[file]}))


def _named(answer: Answer) -> dict[str, Any]:
    """The keys that say which shape a record is about."""
    row = answer.row
    return {"file": name_as_data(row["file"])} | ({} if row["label"] is None else {"label": row["label"]})
