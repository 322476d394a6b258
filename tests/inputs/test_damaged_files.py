"""Damaged files of every format end in an error about the file: quickly, in little memory, and never in a crash.

`benchmarks/fuzz.py` does the same with thousands of files; those that showed bugs are kept in `tests/data/damaged`.
"""

from __future__ import annotations

import multiprocessing
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damage import DAMAGED, MUTATIONS, intact
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reading_damaged import SLOW, how_it_ends, read_all, reader_of

import topokit as tk
from topokit.errors import ReadError

KEPT = Path(__file__).resolve().parents[1] / "data" / "damaged"
N_FILES = 200
FEWER = {"TorchScript": 40, "torch.export": 30}  # each takes 20 to 50 ms
FORMATS = sorted(DAMAGED)


def prepared(name: str, folder: Path) -> tuple[Path, Any]:
    """Where to write files of a format, and their reader; skips if a package is missing."""
    pytest.importorskip("lazrs" if name == "laz" else "numpy")
    path, read = folder / DAMAGED[name][0], reader_of(name)
    path.write_bytes(intact(name, np.random.default_rng(0)))
    read(path)
    return path, read


@pytest.mark.long
@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files_end_in_an_error_about_the_file(name: str, tmp_path: Path) -> None:
    path, read = prepared(name, tmp_path)
    rng = np.random.default_rng(0)
    outcome = read_all((DAMAGED[name][1](rng) for _ in range(FEWER.get(name, N_FILES))), path, read)
    assert outcome.bugs == {}
    assert outcome.slowest < SLOW
    assert len(outcome.messages) > 2, "the mutations do not reach what the reader checks"


@settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    name=st.sampled_from([name for name in FORMATS if name not in FEWER]),
    seed=st.integers(0, 2**32 - 1),
    mutations=st.lists(st.tuples(st.sampled_from(MUTATIONS), st.integers(0, 2**32 - 1)), min_size=1, max_size=4),
)
def test_any_chain_of_mutations_of_any_valid_file(
    name: str, seed: int, mutations: list[tuple[Any, int]], tmp_path: Path
) -> None:
    content = bytearray(intact(name, np.random.default_rng(seed)))
    for mutate, at in mutations:
        content = mutate(content, np.random.default_rng(at)) if content else content
    path = tmp_path / DAMAGED[name][0]
    path.write_bytes(content)
    kind, is_bug = how_it_ends(path, reader_of(name))
    assert not is_bug, kind


def read_within(path: Path) -> None:
    """In a process of its own: an exit code of 0 is an error about the file, or a shape."""
    import resource

    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + (2 << 30),) * 2)
    kind, is_bug = how_it_ends(path, tk.load)
    sys.exit(f"{path.name}: {kind}" if is_bug else 0)


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited as Linux does it")
@pytest.mark.parametrize("path", sorted(KEPT.iterdir()), ids=lambda path: path.name)
def test_files_that_showed_bugs_stay_errors_in_two_gibibytes(path: Path) -> None:
    process = multiprocessing.get_context("fork").Process(target=read_within, args=(path,))
    process.start()
    process.join(60)
    process.kill()
    assert process.exitcode == 0


def test_a_bug_of_a_reader_is_not_called_a_damaged_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from topokit.adapters.mesh.formats import off

    def broken(*_: object) -> None:
        raise TypeError("a bug")

    monkeypatch.setattr(off, "fans", broken)
    (tmp_path / "f.off").write_bytes(intact("off", np.random.default_rng(0)))
    assert how_it_ends(tmp_path / "f.off", tk.load)[1]
    with pytest.raises(tk.TopokitError, match=r"TypeError: a bug") as caught:
        tk.load(tmp_path / "f.off")
    assert not isinstance(caught.value, ReadError)
