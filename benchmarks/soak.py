"""Random files and options in one process for a long time: python -m benchmarks.soak [MINUTES] [SEED]

Files are valid and damaged ones of every format, questions and options are drawn. Printed are memory, open files and
threads over time. At the end the answers about fixed shapes must equal those at the start, memory must not have grown
in the last part of the time, and no file or thread may have been left behind.
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os
import platform
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import torch

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from damage import DAMAGED, intact  # noqa: E402

import topokit as tk  # noqa: E402
from topokit.errors import AdapterError, TopokitError  # noqa: E402
from topokit.testing import genus_mesh, torus_samples  # noqa: E402

MINUTES = 120.0
SETTLED, HALF = 0.2, 0.6  # shares of the time: the median of memory from the second on is compared with that before
GROWTH = 32.0  # MiB by which these may differ: pools of allocators
INTACT = 0.5  # share of files that are not damaged
ADAPTERS = {"TorchScript": "sdf", "torch.export": "sdf", "3dgs": "splats", "3dgs as text": "splats", "splat": "splats"}
GLIBC = platform.libc_ver()[0] == "glibc"
Rng = np.random.Generator

QUESTIONS: dict[str, Callable[[Any], object]] = {
    "report": lambda shape: shape.report(),
    "details": lambda shape: shape.report(details=True),
    "locate": lambda shape: shape.report(locate=True),
    "genus": lambda shape: shape.genus(),
    "euler": lambda shape: shape.euler(),
    "gauss_bonnet": lambda shape: shape.gauss_bonnet(),
    "curvature": lambda shape: shape.curvature(),
    "handles": lambda shape: shape.handles(),
    "boundaries": lambda shape: shape.boundaries(),
    "downsample": lambda shape: shape.downsample(50),
    "page": lambda shape: shape.save_html(Path(tempfile.gettempdir()) / f"topokit-soak-{os.getpid()}.html"),
}


def options_of(name: str, rng: Rng) -> dict[str, Any]:
    """Options that the adapter of a format may have; not all have all."""
    options: dict[str, Any] = {}
    if rng.random() < 0.4:
        options["n_samples"] = int(rng.choice([4, 50, 400]))
    if rng.random() < 0.3:
        options["n_neighbors"] = int(rng.choice([3, 6, 20]))
    if "volume" in name or name.startswith(("nii", "nrrd", "tif")):
        options |= {"level": float(rng.uniform(0, 200)), "connectivity": int(rng.choice([6, 26]))}
    if name in ("TorchScript", "torch.export"):
        options |= {"resolution": 128, "field_resolution": 16}
    return options


def step(folder: Path, rng: Rng, name: str | None = None) -> str:
    """One file, one question; what it ended in."""
    name = name or list(DAMAGED)[int(rng.integers(len(DAMAGED)))]
    suffix, damage = DAMAGED[name]
    path = folder / suffix
    path.write_bytes(intact(name, rng) if rng.random() < INTACT else damage(rng))
    question = list(QUESTIONS)[int(rng.integers(len(QUESTIONS)))]
    try:
        QUESTIONS[question](tk.load(path, adapter=ADAPTERS.get(name), **options_of(name, rng)))
    except AdapterError as error:
        raise AssertionError(f"{question} of a damaged {name} shows a bug; its file is {path}") from error
    except TopokitError as error:
        return type(error).__name__
    return "answered"


def answers() -> list[object]:
    """Reports of fixed shapes, without times."""
    cloud = torus_samples(3000)
    volume = torch.zeros(12, 12, 12)
    volume[2:10, 2:10, 2:10] = 1
    volume[4:8, 4:8, :] = 0
    shapes = [
        tk.from_mesh(*genus_mesh(2), n_samples=800),
        tk.from_points(cloud.points),
        tk.from_points(cloud.points, cloud.normals),
        tk.from_voxels(volume, level=0.5),
        tk.from_sdf(lambda x: x.norm(dim=1) - 0.7, resolution=128, n_samples=500),
    ]
    return [_without_times(shape.report(details=True).to_dict()) for shape in shapes]


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(inner) for key, inner in value.items() if "seconds" not in key}
    return [_without_times(inner) for inner in value] if isinstance(value, list) else value


def held() -> tuple[float, int, int]:
    """MiB of memory, open files, threads; freed pages that glibc keeps for later are given back first."""
    gc.collect()
    if GLIBC:
        ctypes.CDLL(None).malloc_trim(0)
    process = psutil.Process()
    return process.memory_info().rss / 2**20, process.num_fds(), process.num_threads()


def _with_one_arena() -> None:
    """Start again with one arena of glibc: pages that the arenas of several threads keep would hide a leak."""
    if GLIBC and "MALLOC_ARENA_MAX" not in os.environ:
        os.environ["MALLOC_ARENA_MAX"] = "1"
        os.execv(sys.executable, [sys.executable, "-m", "benchmarks.soak", *sys.argv[1:]])


def main() -> None:
    _with_one_arena()
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else MINUTES
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    logging.disable()
    warnings.simplefilter("ignore")
    rng, endings = np.random.default_rng(seed), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for name in DAMAGED:  # each library is imported once, which takes memory
            step(Path(folder), rng, name)
    first, started = answers(), time.monotonic()
    seen: list[tuple[float, float, int, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        while (share := (time.monotonic() - started) / 60 / minutes) < 1:
            if not seen or share - seen[-1][0] > 0.05:
                seen.append((share, *held()))
                print("{:4.0%}  {:7.1f} MiB, {} files, {} threads".format(*seen[-1]), sum(endings.values()), flush=True)
            endings[step(Path(folder), rng)] += 1
    assert answers() == first, "answers have changed"
    early = [row for row in seen if SETTLED <= row[0] < HALF]
    late = [row for row in seen if row[0] >= HALF]
    growth = float(np.median([row[1] for row in late]) - np.median([row[1] for row in early]))
    print(f"{sum(endings.values())} files: {dict(endings)}; {growth:+.1f} MiB, answers unchanged")
    assert growth < GROWTH, "memory grows"
    assert late[-1][2:] <= (early[0][2] + 2, early[0][3] + 2), "files or threads are left behind"


if __name__ == "__main__":
    main()
