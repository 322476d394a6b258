"""Files on a Dask cluster: every row once, whatever happens to workers."""

from __future__ import annotations

import os
import shutil
import signal
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import topokit as tk
from topokit.batch.files_on_dask import connected, map_on_cluster
from topokit.errors import InputError

pytest.importorskip("distributed")

pytestmark = pytest.mark.long  # workers take seconds to start
DATA = Path(__file__).resolve().parents[1] / "data"
NAMES = ("sphere.ply", "torus.stl", "bowl.obj", "truncated.stl")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in range(20):
        name = NAMES[number % len(NAMES)]
        shutil.copy(DATA / name, tmp_path / f"{number:02}{Path(name).suffix}")
    return tmp_path


def answered(rows: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    return [(row["file"], row["euler"], row["verdict"], row["error"]) for row in rows]


def kills_its_worker(task: int) -> int:
    """The task, or the end of the process that tries it."""
    if task < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return task


def test_rows_are_those_of_one_process(dask_client: Any, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parent)  # the workers are elsewhere
    expected = tk.survey(folder.name)
    found = tk.survey(folder.name, client=dask_client)
    assert sorted(answered(list(found))) == sorted(answered(found.rows)) == answered(expected.rows)
    assert answered(found.rows) == answered(expected.rows)


def test_a_worker_killed_in_the_middle_costs_no_row(dask_client: Any, folder: Path) -> None:
    pids = dask_client.run(os.getpid)
    survey = tk.survey([folder] * 3, client=dask_client)
    for number, _ in enumerate(survey):
        if number == 5:
            os.kill(min(pids.values()), signal.SIGKILL)
    assert answered(survey.rows) == answered(tk.survey(folder).rows) * 3


def test_a_task_that_kills_workers_costs_one_result(dask_client: Any) -> None:
    tasks = [1, 2, -3, *range(4, 12)]
    deaths: list[str] = []
    found = dict(map_on_cluster(kills_its_worker, tasks, dask_client, lambda task, how: deaths.append(how) or 0))
    assert [found[number] for number in range(len(tasks))] == [task if task > 0 else 0 for task in tasks]
    assert deaths == ["the workers of the cluster that examined it died, one after the other"]


def test_a_large_volume_is_counted_by_all_workers(
    dask_client: Any, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.save(folder / "volume.npy", np.random.default_rng(0).random((20, 30, 40)) < 0.3)
    expected = tk.survey(folder).rows
    monkeypatch.setattr("topokit.adapters.voxels.larger_than_memory.MOST_IN_MEMORY", 1000)
    from topokit.adapters.voxels import larger_than_memory

    clients: list[Any] = []
    original = larger_than_memory.answer_in_blocks

    def watched(*given: Any) -> Any:
        clients.append(signature(original).bind(*given).arguments["client"])
        return original(*given)

    monkeypatch.setattr(larger_than_memory, "answer_in_blocks", watched)
    assert answered(tk.survey(folder, client=dask_client).rows) == answered(expected)
    assert clients == [dask_client]


def test_limits_hold_on_the_workers(dask_client: Any, tmp_path: Path) -> None:
    shutil.copy(DATA / "sphere.ply", tmp_path / "a.ply")
    (tmp_path / "b.xyz").write_text("\n".join(f"{n % 97} {n % 89} {n % 83}" for n in range(400_000)))
    shutil.copy(DATA / "torus.stl", tmp_path / "c.stl")
    before = dask_client.run(os.getpid)
    rows = tk.survey(tmp_path, time_limit=3, client=dask_client).rows
    assert [row["euler"] for row in rows] == [2, None, 0]
    assert rows[1]["error"] == f"{tmp_path / 'b.xyz'}: it took longer than the time limit of 3 s."
    assert dask_client.run(os.getpid) == before  # what ended was no worker


def test_addresses_without_a_scheduler() -> None:
    with pytest.raises(InputError, match=r"no scheduler answers at 'nonsense://x'"), connected("nonsense://x"):
        pass
