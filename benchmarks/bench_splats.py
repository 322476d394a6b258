"""Reading one million splats, as a multiple of the time in which numpy reads the same bytes.

python -m pytest benchmarks/bench_splats.py -s
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk

N_SPLATS = 1_000_000
ROUNDS = 7
MOST = 3.0
BEFORE = ("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2")
AFTER = ("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")


def write_million(path: Path, n_harmonics: int) -> int:
    """A 3DGS .ply of random numbers, written in blocks; returns the length of its header."""
    names = (*BEFORE, *(f"f_rest_{i}" for i in range(n_harmonics)), *AFTER)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {N_SPLATS}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    rng = np.random.default_rng(0)
    with path.open("wb") as file:
        file.write(header.encode())
        for _ in range(10):
            rng.standard_normal((N_SPLATS // 10, len(names)), dtype=np.float32).tofile(file)
    return len(header)


def seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    result = work()
    spent = time.perf_counter() - started
    del result
    return spent


@pytest.mark.parametrize(
    ("n_harmonics", "is_limited"), [(45, True), (0, False)], ids=["degree 3 (62 columns)", "degree 0 (17 columns)"]
)
def test_reading_a_million_splats(n_harmonics: int, is_limited: bool, tmp_path: Path) -> None:
    """The full layout of the 3DGS trainer is held to the limit; the bare one, a quarter of the bytes, is shown."""
    torch.set_num_threads(1)  # numpy reads with one
    path = tmp_path / "million.ply"
    offset = write_million(path, n_harmonics)
    tk.GaussianSplats.from_file(path)
    pairs = [
        (
            seconds(lambda: np.fromfile(path, dtype="<f4", offset=offset)),
            seconds(lambda: tk.GaussianSplats.from_file(path)),
        )
        for _ in range(ROUNDS)
    ]
    plain, read = (statistics.median(column) for column in zip(*pairs, strict=True))
    path.unlink()
    print(f"\n{path.name}, {n_harmonics} harmonics: fromfile {plain:.3f} s, topokit {read:.3f} s, {read / plain:.2f} ×")
    assert not is_limited or read < MOST * plain
