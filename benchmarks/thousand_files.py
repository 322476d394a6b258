"""Many files on a local cluster with a worker killed in the middle, then a survey that is stopped and goes on.

    python benchmarks/thousand_files.py [--files 1000]

Every row must be there once, none lost, none twice; after the stop no file is examined again.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import tempfile
import time
from itertools import islice
from pathlib import Path

from bench_survey import write_files

import topokit as tk
from topokit.batch.files_on_dask import connected


def main() -> None:
    """Do both, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=1000)
    count = parser.parse_args().files
    with tempfile.TemporaryDirectory() as name, connected("local", 2) as client:
        folder = Path(name) / "files"
        folder.mkdir()
        paths = [str(path) for path in write_files(folder, count)]
        started = time.perf_counter()
        survey, victim = tk.survey(folder, client=client), min(client.run(os.getpid).values())
        for number, _ in enumerate(survey):
            if number == count // 2:
                os.kill(victim, signal.SIGKILL)
        assert [row["file"] for row in survey.rows] == paths
        assert all(row["error"] is None for row in survey.rows)
        print(
            f"{count} files, worker {victim} killed after {count // 2}: every row there once, "
            f"{time.perf_counter() - started:.1f} s"
        )
        journal = Path(name) / "rows.jsonl"
        kept = len(list(islice(tk.survey(folder, client=client, resume=journal), count // 3)))
        before = journal.read_bytes()
        rows = tk.survey(folder, client=client, resume=journal).rows
        lines = [json.loads(line)["file"] for line in journal.read_text().splitlines()]
        assert journal.read_bytes().startswith(before)
        assert sorted(lines) == [row["file"] for row in rows] == paths
        print(f"stopped after {kept} rows and resumed: {len(lines)} lines, every file once")


if __name__ == "__main__":
    main()
