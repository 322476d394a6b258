"""Start-up: `topokit --help` against a bare typer application, and what topokit adds to the import of torch.

    python benchmarks/bench_start.py

It fails if help takes more than 1.5 × a bare typer app's, or `import topokit` more than 20 ms beyond `import torch`
alone, with ten plug-ins installed or none. Two imports of torch differ by more than that, so topokit's share is
measured within one process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
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
SHARE = """
from time import perf_counter
a = perf_counter(); import torch
b = perf_counter(); import topokit
c = perf_counter(); topokit.list_adapters()
print(b - a, c - b, perf_counter() - c, len(topokit.list_adapters()))
"""
PLUGIN = Path(__file__).parents[1] / "examples" / "custom_adapter" / "topokit_metaballs.py"
N_PLUGINS = 10
RUNS = 9


def seconds(*command: str) -> float:
    started = perf_counter()
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    return perf_counter() - started


def compare(name: str, ours: tuple[str, ...], theirs: tuple[str, ...], runs: int = 15) -> float:
    pairs = [(seconds(*ours), seconds(*theirs)) for _ in range(runs)]
    ratio = median(a / b for a, b in pairs)
    print(f"{name}: {median(a for a, _ in pairs):.3f} s, {median(b for _, b in pairs):.3f} s, ratio {ratio:.2f}")
    return ratio


def install_copies(folder: Path) -> None:
    """Ten copies of the example plug-in as pip leaves them: a module and a dist-info folder each."""
    code = PLUGIN.read_text(encoding="utf-8")
    for index in range(N_PLUGINS):
        name = f"metaballs_{index}"
        (folder / f"{name}.py").write_text(code.replace('"metaballs"', f'"{name}"'), encoding="utf-8")
        info = folder / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(f"[topokit.adapters]\n{name} = {name}:Metaballs\n", encoding="utf-8")


def share(name: str, folder: str) -> None:
    """Medians over processes: the import of torch, topokit's after it, and the first look at the adapters."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (folder, *sys.path)))}
    rows = []
    for _ in range(RUNS):
        command = [sys.executable, "-c", SHARE]
        found = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
        rows.append([float(word) for word in found.stdout.split()])
    torch, topokit, listing, count = (median(column) for column in zip(*rows, strict=True))
    most = max(row[1] for row in rows)
    print(
        f"{name}: import torch {1000 * torch:.0f} ms, import topokit after it {1000 * topokit:.1f} ms more (at most "
        f"{1000 * most:.1f}), first look at {count:.0f} adapters {1000 * listing:.1f} ms"
    )
    assert topokit < 0.020, f"{name}: import topokit takes {1000 * topokit:.1f} ms, more than 20 ms"


if __name__ == "__main__":
    ratio = compare("topokit --help, bare typer app", ("-m", "topokit", "--help"), ("-c", BARE, "--help"))
    assert ratio <= 1.5, f"topokit --help takes {ratio:.2f} × a bare typer app's"
    compare("import topokit and torch, torch alone", ("-c", "import topokit, torch"), ("-c", "import torch"), 7)
    share("no plug-in", "")
    with tempfile.TemporaryDirectory() as folder:
        install_copies(Path(folder))
        share(f"{N_PLUGINS} plug-ins", folder)
