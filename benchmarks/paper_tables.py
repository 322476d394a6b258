"""The paper's experiments: its tables with the paper's numbers beside those found here, as Markdown.

    python benchmarks/paper_tables.py SUBCOMMAND [--part PART] [--seeds 5] [--quick] [--data DIR] [--json OUT]

| subcommand | |
|---|---|
| curvature | Table I: errors of curvature on sphere, ellipsoid and torus |
| study | error of curvature against noise, density, k and kind of normals, and against its peers |
| topology | Table II: Euler characteristics of shapes, and of all clean meshes of DATA |
| ablation | least-squares solver, area, normals, self-optimization |
| persistence | persistent homology on the same clouds |
| self-optimization | convergence to the target |
| time | seconds and memory |
| figures | pictures into docs/pictures |

DATA holds index.json and the shapes that it names. Baselines need pymeshlab, gudhi, ripser and open3d, figures
matplotlib; where one is missing its rows are left out, with a sentence. Progress goes to stderr.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # so that the script runs from anywhere

import torch  # noqa: E402

from benchmarks.paper.clean_meshes import WAYS  # noqa: E402
from benchmarks.paper.printed import TABLE_2  # noqa: E402
from benchmarks.paper.scores import ROW_SETTINGS  # noqa: E402
from benchmarks.paper.tables import Options  # noqa: E402

SUBCOMMANDS = {
    "curvature": "curvature",
    "study": "study",
    "topology": "topology",
    "ablation": "ablation",
    "persistence": "persistence",
    "self-optimization": "self_optimization",
    "time": "time_and_memory",
    "figures": "figures",
}
PACKAGES = ("torch", "numpy", "scipy", "trimesh", "pymeshlab", "open3d", "gudhi", "ripser")


def versions() -> str:
    """Commit, processor and versions, as a sentence."""
    shown = []
    for name in PACKAGES:
        try:
            shown.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            shown.append(f"no {name}")
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    threads = f"{torch.get_num_threads()} thread" + "s" * (torch.get_num_threads() > 1)
    machine = f"{platform.machine()}, {os.cpu_count()} cores, {threads}"
    python = f"Python {platform.python_version()}"
    return f"Commit {commit.stdout.strip() or 'unknown'}; {machine}; {', '.join((python, *shown))}."


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subcommand", choices=SUBCOMMANDS)
    parser.add_argument("--seeds", type=int, default=5, help="random draws (default: 5)")
    parser.add_argument("--quick", action="store_true", help="few points, shapes and seeds")
    parser.add_argument("--data", type=Path, help="folder with index.json")
    parser.add_argument("--thingi10k", type=Path, help="folder with meshes NUMBER.stl or NUMBER.obj of Thingi10K")
    parser.add_argument("--json", type=Path, help="also write the tables to this file")
    parser.add_argument("--pictures", type=Path, default=ROOT / "docs" / "pictures", help="folder for figures")
    parser.add_argument("--every", type=int, default=1, help="topology: every n-th of the clean meshes of DATA")
    parser.add_argument("--part", default="all", help="a part of curvature, study, topology or time")
    parser.add_argument("--rows", nargs="+", default=(), choices=TABLE_2, metavar="ROW", help="topology: these rows")
    parser.add_argument("--settings", nargs="+", default=(), choices=ROW_SETTINGS, help="topology: rows in these")
    parser.add_argument("--methods", nargs="+", default=(), choices=WAYS, help="topology: these, on the clean meshes")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> int:
    """Print the tables of one subcommand."""
    given = arguments(words)
    for folder in (given.data, given.thingi10k):
        if folder is not None and not folder.is_dir():
            print(f"{folder} is not a folder.", file=sys.stderr)
            return 2
    seeds = 1 if given.quick else given.seeds
    folders = (given.data, given.thingi10k, given.pictures)
    chosen = (given.every, given.part, tuple(given.rows), tuple(given.settings), tuple(given.methods))
    options = Options(seeds, given.quick, *folders, *chosen)
    module = importlib.import_module(f"benchmarks.paper.{SUBCOMMANDS[given.subcommand]}")
    parts = ("all", *getattr(module, "PARTS", ()))
    if given.part not in parts:
        print(f"{given.subcommand} has no part {given.part!r}, only {', '.join(parts)}.", file=sys.stderr)
        return 2
    found = module.tables(options)
    seconds = sum(os.times()[:4])  # of the processor, with processes that were started
    print("\n".join(table.markdown() for table in found))
    print(f"`{given.subcommand}` took {seconds:.0f} CPU s. {versions()}")
    if given.json is not None:
        content = {"versions": versions(), "seconds": seconds, "tables": [table.to_dict() for table in found]}
        given.json.write_text(json.dumps(content, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
