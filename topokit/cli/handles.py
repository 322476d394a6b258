"""The command that lists the handles of a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from topokit.cli.options import Opener, opens_files
from topokit.cli.request import Format
from topokit.cli.single import ask
from topokit.text import json_text

if TYPE_CHECKING:
    from topokit.shape import Shape


@opens_files
def handles(
    file: Annotated[str, typer.Argument(help="A mesh, points, a volume, a network or splats.", metavar="FILE")],
    opener: Opener,
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

        found = located_handles(shape.handles())
        if output is not None:
            save_loops(Location(found, (), (), ()), output)
        rows = plain(found)
        if as_json:
            return json_text(rows, indent=2)
        numbers = ((row["handle_length"], row["tunnel_length"], *row["center"]) for row in rows)
        return "\n".join("\t".join(f"{number:.6g}" for number in line) for line in numbers)

    ask(file, format, opener, answer, output)
