"""Start-up: `topokit --help` against a bare typer application, and the import of topokit against torch's.

    python benchmarks/bench_start.py

Asked for: help at most 1.5 × a bare typer app's.
"""

from __future__ import annotations

import subprocess
import sys
from statistics import median
from time import perf_counter

BARE = """
import typer
app = typer.Typer()
@app.command()
def one(name: str) -> None: "One."
@app.command()
def two(name: str) -> None: "Two."
app()
"""


def seconds(*command: str) -> float:
    started = perf_counter()
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    return perf_counter() - started


def compare(name: str, ours: tuple[str, ...], theirs: tuple[str, ...], runs: int = 15) -> None:
    pairs = [(seconds(*ours), seconds(*theirs)) for _ in range(runs)]
    ratio = median(a / b for a, b in pairs)
    print(f"{name}: {median(a for a, _ in pairs):.3f} s, {median(b for _, b in pairs):.3f} s, ratio {ratio:.2f}")


if __name__ == "__main__":
    compare("topokit --help, bare typer app", ("-m", "topokit", "--help"), ("-c", BARE, "--help"))
    compare("import topokit and torch, torch alone", ("-c", "import topokit, torch"), ("-c", "import torch"), 7)
