"""Damaged files of every format, thousands of each: python -m benchmarks.fuzz [FILES] [SEED] [FORMAT ...]

Each format is read in a process of its own with 2 GiB of addresses above what it has after its imports, so that a
header that is believed shows as a MemoryError, and a reader that crashes costs one format. Printed are the counts of
what files end in, the slowest file and the growth of memory; files that show bugs are saved in a folder that is printed
last. A file over a minute ends its process with a traceback.
"""

from __future__ import annotations

import faulthandler
import logging
import multiprocessing
import resource
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from damage import DAMAGED, Damage, intact  # noqa: E402
from reading_damaged import Outcome, read_all, reader_of  # noqa: E402

N_FILES = 20_000
GIBIBYTES = 2.0
HANGS = 60.0  # s for one file


def fuzz(name: str, count: int, seed: int, saved: Path) -> None:
    """Read damaged files of a format, print what they end in, and exit with 1 if there was a bug."""
    suffix, damage = DAMAGED[name]
    read = reader_of(name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / suffix
        for number in range(20):  # imports take memory, too
            path.write_bytes(intact(name, np.random.default_rng(number)))
            read(path)
        before = _limit_addresses()
        started = time.process_time()
        outcome = read_all(_files(damage, count, seed, saved / f"{name} that crashed"), path, read)
        faulthandler.cancel_dump_traceback_later()
    growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20 - before
    print(f"{name}: {count} files, {time.process_time() - started:.0f} CPU s, {growth:.2f} GiB more memory, ", end="")
    _print(outcome, name, saved)
    sys.exit(int(bool(outcome.bugs) or growth > GIBIBYTES))


def _files(damage: Damage, count: int, seed: int, last: Path) -> Iterator[bytes]:
    """Damaged files; each is kept under one name while it is read, for the case that it crashes the reader."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        content = damage(rng)
        last.write_bytes(content)
        faulthandler.dump_traceback_later(HANGS, exit=True)
        yield content
    last.unlink()


def _print(outcome: Outcome, name: str, saved: Path) -> None:
    print(f"slowest {outcome.slowest:.2f} s, {outcome.messages['read']} read, {len(outcome.bugs)} bugs")
    for message, number in outcome.messages.most_common(40):
        print(f"  {number:6} {message}")
    for kind, content in outcome.bugs.items():
        place = saved / f"{name} {zlib.crc32(kind.encode()):08x}"
        place.write_bytes(content)
        print(f"  BUG {kind}\n      {place}")


def _limit_addresses() -> float:
    """Allow so many GiB more than now; the most memory that was held so far."""
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + int(GIBIBYTES * 2**30),) * 2)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def main() -> None:
    count, seed = (int(text) for text in (*sys.argv[1:3], *(str(N_FILES), "0")[len(sys.argv[1:3]) :]))
    logging.disable()
    warnings.simplefilter("ignore")
    saved, codes = Path(tempfile.mkdtemp(prefix="topokit-fuzz-")), {}
    for name in sys.argv[3:] or DAMAGED:
        process = multiprocessing.get_context("fork").Process(target=fuzz, args=(name, count, seed, saved))
        process.start()
        process.join()
        codes[name] = process.exitcode
        sys.stdout.flush()
    wrong = {name: code for name, code in codes.items() if code}
    print(f"formats with bugs, by exit code: {wrong or 'none'}; files in {saved}")
    sys.exit(int(bool(wrong)))


if __name__ == "__main__":
    main()
