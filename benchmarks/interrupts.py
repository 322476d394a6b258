"""Signals at random moments of the command, over all representations: python -m benchmarks.interrupts [MOMENTS] [SEED]

Each run must end with exit code 130 (SIGINT) or 143 (SIGTERM), one line on standard error, whole rows and no unfinished
file. Moments are drawn in CPU time of the process, uniformly over that of an undisturbed run, so that a busy machine
does not move them. Before Python has loaded `topokit`, which takes some 0.1 s, the interpreter alone answers signals;
these runs are counted apart.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import torch

TOPOKIT = [sys.executable, "-m", "topokit"]
N_MOMENTS = 200
TERMINATED_EVERY = 4  # one run in so many is ended by SIGTERM instead
SHARE = 0.95  # of the CPU time of an undisturbed run, within which the signals come
POLL = 0.02  # s
SLOWEST = 60.0  # s from the signal to the end
CLEAN, ENDED, BEFORE = "clean", "had ended", "before topokit was loaded"
FINE = {CLEAN, ENDED, BEFORE}


class Ball(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return (x * x).sum(-1).sqrt() - 0.7


@dataclass(frozen=True)
class Run:
    """A command by its name, and the file that it writes besides, or None."""

    name: str
    arguments: tuple[str, ...]
    output: Path | None = None


def write_runs(folder: Path) -> list[Run]:
    """The files of every representation, and what to ask about them."""
    from plyfile import PlyData, PlyElement

    import topokit as tk
    from topokit.testing import genus_mesh, torus_samples

    mesh = tk.from_mesh(*genus_mesh(3)).to_trimesh()
    samples = torus_samples(60_000)
    several = folder / "several"
    several.mkdir()
    for number in range(6):
        mesh.export(several / f"{number:02}.ply")
    np.save(folder / "points.npy", samples.points[:4000].numpy())
    np.save(folder / "many.npy", samples.points.numpy())
    np.save(folder / "oriented.npy", torch.cat((samples.points, samples.normals), 1)[:4000].numpy())
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 90)] * 3, indexing="ij"))
    np.save(folder / "volume.npy", 0.7 - np.linalg.norm(grid, axis=0))
    torch.jit.save(torch.jit.script(Ball()), folder / "net.pt")
    names = ("x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "opacity")
    splats = np.ones(4000, dtype=[(name, "f4") for name in names])
    splats["x"], splats["y"], splats["z"] = samples.points[:4000].T.numpy()
    for name in ("scale_0", "scale_1", "scale_2"):
        splats[name] = np.log(0.03)
    PlyData([PlyElement.describe(splats, "vertex")]).write(str(folder / "splats.ply"))
    page, table = folder / "page.html", folder / "colors.ply"
    return [
        Run("mesh", ("report", str(several / "00.ply"), "--details")),
        Run("points", ("report", str(folder / "points.npy"))),
        Run("many points", ("report", str(folder / "many.npy"))),
        Run("oriented points", ("report", str(folder / "oriented.npy"))),
        Run("voxels", ("report", str(folder / "volume.npy"), "--level", "0")),
        Run("sdf", ("report", str(folder / "net.pt"), "--adapter", "sdf", "--resolution", "128")),
        Run("splats", ("report", str(folder / "splats.ply"))),
        Run("folder", ("report", str(several), "--json")),
        Run("folder, 2 jobs", ("report", str(several), "--json", "--jobs", "2")),
        Run("page", ("report", str(several), "--jsonl", "--html", str(page)), page),
        Run("colors", ("curvature", str(several / "00.ply"), "-o", str(table)), table),
    ]


def undisturbed(run: Run) -> float:
    """CPU seconds of the command, without those of processes that it starts, if no signal comes."""
    process = subprocess.Popen([*TOPOKIT, *run.arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    watched, seconds = psutil.Process(process.pid), 0.0
    while process.poll() is None:
        seconds = max(seconds, 0.0, *(found for found in [_cpu_time(watched)] if found < float("inf")))
        time.sleep(POLL)
    assert process.returncode == 0, run
    return seconds


def disturbed(run: Run, number: signal.Signals, at: float) -> tuple[str, float]:
    """How a run ends that gets a signal after so much CPU time, and how many seconds after."""
    if run.output is not None:
        run.output.unlink(missing_ok=True)
    process = subprocess.Popen(
        [*TOPOKIT, *run.arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    watched = psutil.Process(process.pid)
    while process.poll() is None and _cpu_time(watched) < at:
        time.sleep(POLL)
    sent = time.monotonic()
    process.send_signal(number)
    out, errors = process.communicate(timeout=SLOWEST)
    return _judged(run, number, process.returncode, out.decode(), errors.decode()), time.monotonic() - sent


def _cpu_time(process: psutil.Process) -> float:
    """Of a process, without its children, which are slow to list; infinite if it is gone."""
    try:
        return float(sum(process.cpu_times()[:2]))
    except psutil.Error:
        return float("inf")


def _judged(run: Run, number: signal.Signals, code: int, out: str, errors: str) -> str:
    if code == 0 and not errors:
        return ENDED
    if code in (-number, 1) and "topokit" not in errors.replace("-m topokit", "") and not out:
        return BEFORE
    if code != 128 + number:
        return f"exit code {code}: {errors[-300:]}"
    if errors.count("\n") != 1 or "Traceback" in errors:
        return f"standard error: {errors[-300:]}"
    if "--json" in run.arguments and out:
        json.loads(out)
    if "--jsonl" in run.arguments:
        assert all(json.loads(line) for line in out.splitlines())
        assert not out or out.endswith("\n")
    if run.output is not None:
        left = [path.name for path in run.output.parent.iterdir() if ".part" in path.name]
        if left or (run.output.exists() and run.output.stat().st_size == 0):
            return f"unfinished files: {left}"
    return CLEAN


def moments(runs: list[Run], count: int, seed: int) -> Iterator[tuple[Run, signal.Signals, float]]:
    """Runs in turn with the signal and the share of their CPU time at which it comes."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        is_terminated = index % TERMINATED_EVERY == TERMINATED_EVERY - 1
        yield runs[index % len(runs)], signal.SIGTERM if is_terminated else signal.SIGINT, SHARE * rng.random()


def main() -> None:
    count, seed = (int(text) for text in (*sys.argv[1:], *(str(N_MOMENTS), "0")[len(sys.argv) - 1 :]))
    found: dict[str, Counter[str]] = {}
    slowest: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        runs = write_runs(Path(folder))[:count]
        seconds = {run.name: undisturbed(run) for run in runs}
        for run, number, share in moments(runs, count, seed):
            how, after = disturbed(run, number, share * seconds[run.name])
            found.setdefault(run.name, Counter())[how] += 1
            slowest[run.name] = max(after, slowest.get(run.name, 0.0))
    for name, counts in found.items():
        print(f"{name}: {seconds[name]:.1f} CPU s undisturbed, the slowest end {slowest[name]:.2f} s; {dict(counts)}")
    wrong = {how for counts in found.values() for how in counts} - FINE
    sys.exit("\n".join(sorted(wrong)) or None)


if __name__ == "__main__":
    main()
