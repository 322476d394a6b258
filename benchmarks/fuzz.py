"""Damaged files of every format, thousands of each: python -m benchmarks.fuzz [FILES] [SEED] [FORMAT ...]

Each format is read in a process of its own with 2 GiB of addresses above what it has after its imports, so that a
header that is believed shows as a MemoryError. Printed are the counts of each message, the slowest file and the growth
of memory; bugs are saved with their bytes in a folder that is printed last.
"""

from __future__ import annotations

import faulthandler
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from damage import DAMAGED, intact  # noqa: E402
from reading_damaged import read_all, reader_of  # noqa: E402

N_FILES = 20_000
GIBIBYTES = 2.0
HANGS = 60.0  # s without an end: the process prints where it is, and ends


def fuzz(name: str, count: int, seed: int, saved: Path) -> bool:
    """Read damaged files of a format and print what they end in; whether there was no bug."""
    suffix, next_file = DAMAGED[name]
    read, rng = reader_of(name), np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / suffix
        for number in range(20):  # imports take memory, too
            path.write_bytes(intact(name, np.random.default_rng(number)))
            read(path)
        read_all((next_file(rng) for _ in range(20)), path, read)
        before = _limit_addresses()

        def files() -> object:
            for _ in range(count):
                faulthandler.dump_traceback_later(HANGS, exit=True)
                yield next_file(rng)
                (saved / "last").write_bytes(path.read_bytes()) if os.environ.get("KEEP_LAST") else None

        started = time.process_time()
        outcome = read_all(files(), path, read)  # type: ignore[arg-type]
        faulthandler.cancel_dump_traceback_later()
    seconds = time.process_time() - started
    growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20 - before
    n_read = outcome.messages["read"]
    print(
        f"{name}: {count} files, {n_read} read, {len(outcome.messages) - 1} messages, {len(outcome.bugs)} bugs; ",
        end="",
    )
    print(f"{seconds:.0f} CPU s, slowest {outcome.slowest:.2f} s, {growth:.2f} GiB more memory")
    for message, number in outcome.messages.most_common(40):
        print(f"  {number:6} {message}")
    for kind, content in outcome.bugs.items():
        place = saved / f"{name.replace(' ', '-')}-{abs(hash(kind)) % 10_000:04}-{suffix}"
        place.write_bytes(content)
        print(f"  BUG {kind}\n      {place}")
    return not outcome.bugs and growth < GIBIBYTES


def _limit_addresses() -> float:
    """Allow so many GiB more than now; the most memory that was held so far."""
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + int(GIBIBYTES * 2**30),) * 2)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def main() -> None:
    count, seed = (int(text) for text in (*sys.argv[1:3], *(str(N_FILES), "0")[len(sys.argv[1:3]) :]))
    names = sys.argv[3:] or list(DAMAGED)
    if len(names) == 1:
        saved = Path(os.environ.get("FUZZ_FOLDER") or tempfile.mkdtemp(prefix="topokit-fuzz-"))
        sys.exit(0 if fuzz(names[0], count, seed, saved) else 1)
    saved = Path(tempfile.mkdtemp(prefix="topokit-fuzz-"))
    command = [sys.executable, "-m", "benchmarks.fuzz", str(count), str(seed)]
    codes = {
        name: subprocess.run([*command, name], env=os.environ | {"FUZZ_FOLDER": str(saved)}, cwd=ROOT).returncode
        for name in names
    }
    print(f"bugs are in {saved}: {[name for name, code in codes.items() if code] or 'none'}")
    sys.exit(int(any(codes.values())))


if __name__ == "__main__":
    main()
