"""Volumes counted by the workers of a Dask cluster: the same report, also when a worker dies in the middle."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import topokit as tk
from topokit.adapters.voxels.chosen_part import Entry
from topokit.adapters.voxels.larger_than_memory import blocks_of
from topokit.adapters.voxels.stored_volumes import StoredVolume
from topokit.core.blocks.division import Box
from topokit.core.blocks.on_dask import active_client

dask_array = pytest.importorskip("dask.array")

pytestmark = pytest.mark.long  # workers take seconds to start
VOLUME = np.random.default_rng(0).random((30, 40, 50)) < 0.3


class DeadlyOnce(StoredVolume):
    """A volume whose first reading of one block kills the process that reads it."""

    def __init__(self, mark: Path) -> None:
        super().__init__("deadly", VOLUME.shape, VOLUME.dtype, (10, 10, 10))
        self._mark = mark

    def read(self, box: Box) -> NDArray[Any]:
        """See `StoredVolume`."""
        if box[0][0] >= 10 and not self._mark.exists():
            self._mark.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)
        return VOLUME[tuple(slice(*side) for side in box)]


def test_workers_count_what_memory_counts(dask_client: Any, tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", VOLUME)
    expected = tk.from_voxels(VOLUME, connectivity=6).report()
    sources = (VOLUME, tmp_path / "v.npy", dask_array.from_array(VOLUME, chunks=(11, 13, 17)))
    for source in sources:
        found = tk.from_voxels(source, connectivity=6, block_voxels=3000, client=dask_client).report()
        assert (found.euler, found.reasons) == (expected.euler, expected.reasons)
        assert found.per_component == expected.per_component


def test_workers_count_the_curve_in_memory(dask_client: Any) -> None:
    values = np.random.default_rng(1).random((12, 20, 15))
    levels = [0.2, 0.5, 0.7]
    expected = tk.from_voxels(values, level=0.5).euler_curve(levels)
    shape = tk.from_voxels(values, level=0.5, block_voxels=600, client=dask_client)
    assert shape.euler_curve(levels).betti.tolist() == expected.betti.tolist()
    assert len(shape.euler_curve(4).levels) == 4


def test_a_dask_array_goes_to_the_active_client(dask_client: Any) -> None:
    assert active_client() is dask_client
    assert dask_client.submit(lambda: active_client() is None).result()  # a worker does not wait for others
    blocks = blocks_of(dask_array.from_array(VOLUME, chunks=10), Entry(), 3000, None)
    assert blocks.client is dask_client
    assert blocks_of(VOLUME, Entry(), 3000, None).client is None


def test_a_worker_that_dies_costs_a_retry(dask_client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mark = tmp_path / "killed"
    monkeypatch.setattr("topokit.adapters.voxels.larger_than_memory.stored_volume", lambda *_: DeadlyOnce(mark))
    found = tk.from_voxels("deadly", block_voxels=1500, client=dask_client).report()
    assert int(mark.read_text()) != os.getpid()
    assert found.per_component == tk.from_voxels(VOLUME).report().per_component
