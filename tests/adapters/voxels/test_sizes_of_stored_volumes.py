"""Stored arrays: other files are not opened, and headers that announce far more than is stored are refused."""

from __future__ import annotations

import json
import os
import pickle
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import topokit as tk
from topokit.adapters.voxels.chosen_part import Entry
from topokit.adapters.voxels.opening_stored import stored_volume
from topokit.adapters.voxels.stored_volumes import IndexedVolume, StoredVolume, _lengths
from topokit.errors import ReadError

h5py = pytest.importorskip("h5py")
zarr = pytest.importorskip("zarr")
VALUES = np.arange(64, dtype=np.float64).reshape(4, 4, 4)


@pytest.fixture
def inner(tmp_path: Path) -> Path:
    """A folder, beside which lies secret.h5 with the data set "raw", and secret.bin with the same bytes."""
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["raw"] = VALUES
    (tmp_path / "secret.bin").write_bytes(VALUES.tobytes())
    (tmp_path / "inner").mkdir()
    return tmp_path / "inner"


def opened(path: Path, dataset: str | None = None) -> StoredVolume:
    found = stored_volume(path, Entry(dataset))
    assert found is not None
    return found


def write_zarr(folder: Path, **changed: Any) -> Path:
    """The metadata of a zarr array of version 2, without any chunk."""
    about = {"zarr_format": 2, "shape": [4, 4, 4], "chunks": [4, 4, 4], "dtype": "<f8", "compressor": None}
    folder.mkdir(parents=True)
    (folder / ".zarray").write_text(json.dumps(about | {"fill_value": 0, "filters": None, "order": "C"} | changed))
    return folder


# other files


@pytest.mark.parametrize("name", ["{folder}/secret.bin", "../secret.bin", "beside.bin"])
def test_hdf5_with_external_storage_is_refused(name: str, inner: Path) -> None:
    (inner / "beside.bin").write_bytes(VALUES.tobytes())
    other = name.format(folder=inner.parent)
    with h5py.File(inner / "v.h5", "w") as file:
        file.create_dataset("raw", VALUES.shape, VALUES.dtype, external=[(other, 0, VALUES.nbytes)])
    with pytest.raises(ReadError, match=rf"values of /raw in '{other}'; only the given file"):
        tk.load(inner / "v.h5", level=30)


def test_virtual_data_sets_of_hdf5_are_refused(inner: Path) -> None:
    layout = h5py.VirtualLayout(VALUES.shape, VALUES.dtype)
    layout[:] = h5py.VirtualSource(inner.parent / "secret.h5", "raw", VALUES.shape)
    with h5py.File(inner / "v.h5", "w") as file:
        file.create_virtual_dataset("raw", layout)
    with pytest.raises(ReadError, match=r"values of /raw in '.*secret.h5'; only the given file"):
        tk.load(inner / "v.h5", level=30)


def test_links_of_hdf5_to_other_files_are_not_followed(inner: Path) -> None:
    with h5py.File(inner / "v.h5", "w") as file:
        file["raw"] = h5py.ExternalLink(inner.parent / "secret.h5", "raw")
        file["own"] = np.zeros((3, 3, 3))
    assert opened(inner / "v.h5").whole().max() == 0
    with pytest.raises(ReadError, match="has no array 'raw'"):
        opened(inner / "v.h5", "raw")


def test_data_sets_that_the_caller_opened_may_be_virtual(inner: Path) -> None:
    layout = h5py.VirtualLayout(VALUES.shape, VALUES.dtype)
    layout[:] = h5py.VirtualSource(inner.parent / "secret.h5", "raw", VALUES.shape)
    with h5py.File(inner / "v.h5", "w") as file:
        file.create_virtual_dataset("raw", layout)
    with h5py.File(inner / "v.h5") as file:
        assert tk.from_voxels(file["raw"], level=30).report().euler == 2


@pytest.mark.parametrize("place", ["0.0.0", ".zarray", "deep"])
def test_links_in_a_zarr_folder_are_refused(place: str, inner: Path) -> None:
    (inner.parent / "secret").mkdir()
    volume = write_zarr(inner / "v.zarr")
    if place == ".zarray":
        (volume / ".zarray").rename(inner.parent / "metadata")
        (volume / ".zarray").symlink_to(inner.parent / "metadata")
    else:
        (volume / place).symlink_to(inner.parent / ("secret" if place == "deep" else "secret.bin"))
    with pytest.raises(ReadError, match=f"holds the link '{place}'"):
        opened(volume)


def test_zarr_groups_with_links_in_a_circle_end_at_once(inner: Path) -> None:
    zarr.open_group(inner / "v.zarr", mode="w", zarr_format=2)
    for name in "ab":
        (inner / "v.zarr" / name).symlink_to(inner / "v.zarr")
    with pytest.raises(ReadError, match="holds the link"):
        opened(inner / "v.zarr")


@pytest.mark.parametrize("version", [2, 3])
def test_consolidated_metadata_lead_nowhere_else(version: int, inner: Path) -> None:
    secret = zarr.create_array(inner.parent / "secret.zarr", data=VALUES, zarr_format=version)
    zarr.open_group(inner / "v.zarr", mode="w", zarr_format=version)
    about = json.loads((inner.parent / "secret.zarr" / (".zarray" if version == 2 else "zarr.json")).read_text())
    if version == 2:
        entries = {".zgroup": {"zarr_format": 2}, "../../secret.zarr/.zarray": about}
        content = {"zarr_consolidated_format": 1, "metadata": entries}
        (inner / "v.zarr" / ".zmetadata").write_text(json.dumps(content))
    else:
        group = json.loads((inner / "v.zarr" / "zarr.json").read_text())
        inline = {"kind": "inline", "must_understand": False, "metadata": {"../../secret.zarr": about}}
        (inner / "v.zarr" / "zarr.json").write_text(json.dumps(group | {"consolidated_metadata": inline}))
    assert secret[0, 0, 1] == 1
    for dataset in (None, "../../secret.zarr"):
        with pytest.raises(tk.TopokitError):
            opened(inner / "v.zarr", dataset)


@pytest.mark.parametrize("changed", [{"filters": [{"id": "pickle"}]}, {"compressor": {"id": "pickle"}}])
def test_pickled_chunks_of_zarr_are_not_opened(changed: dict[str, Any], inner: Path) -> None:
    class Harm:
        def __reduce__(self) -> object:
            return os.mkdir, (str(inner / "harm"),)

    volume = write_zarr(inner / "v.zarr", **changed)
    (volume / "0.0.0").write_bytes(pickle.dumps(Harm()))
    with pytest.raises(ReadError):
        opened(volume).whole()
    assert not (inner / "harm").exists()


def test_lists_of_pieces_of_other_files_are_refused(inner: Path) -> None:
    pytest.importorskip("fsspec")
    places = {"version": 1, "refs": {"0.0.0": [str(inner.parent / "secret.bin"), 0, 512]}}
    (inner / "v.zarr").mkdir()
    (inner / "v.zarr" / "refs.json").write_text(json.dumps(places))
    for address in (f"reference::file://{inner}/v.zarr/refs.json", f"reference://0.0.0::file://{inner}/refs.json"):
        with pytest.raises(ReadError, match="lists pieces of other files"):
            tk.load(address)


# sizes


def peak() -> int:
    """Bytes that this process has held at most."""
    resource = pytest.importorskip("resource", reason="not on Windows")
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def test_hdf5_with_no_chunk_costs_nothing(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file.create_dataset("raw", (511, 511, 511), "f8", chunks=(64, 64, 64), compression="gzip")
    started, before = time.perf_counter(), peak()
    with pytest.raises(ReadError, match="announces an array of 1067462648 bytes and stores 0 bytes"):
        tk.load(tmp_path / "v.h5", level=0.5).report()
    assert time.perf_counter() - started < 5
    assert peak() - before < 1 << 28


def test_hdf5_without_end_is_refused(tmp_path: Path) -> None:
    for name, options in (("chunks", {"chunks": (256, 256, 256)}), ("whole", {})):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            found = file.create_dataset("raw", (100_000,) * 3, "u1", **options)
            if options:
                found[:4, :4, :4] = 1
        with pytest.raises(ReadError, match="announces an array of 1000000000000000 bytes"):
            tk.load(tmp_path / f"{name}.h5")


def test_a_chunk_that_takes_all_memory_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "v.h5", "w") as file:
        found = file.create_dataset("raw", (1000,) * 3, "u1", chunks=(1000,) * 3, compression="gzip")
        found.id.write_direct_chunk((0, 0, 0), b"not much")
    with pytest.raises(ReadError, match="a chunk of 1000000000 bytes and stores 8 bytes"):
        tk.load(tmp_path / "v.h5")
    volume = write_zarr(tmp_path / "v.zarr", shape=[1000] * 3, chunks=[10_000] * 3)
    (volume / "0.0.0").write_bytes(b"not much")
    with pytest.raises(ReadError, match="a chunk of 8000000000000 bytes and stores 8 bytes"):
        tk.load(volume)


@pytest.mark.parametrize("shape", [(10**9, 2, 2), (10**5, 10**5, 10**5)])
def test_zarr_with_no_chunk_costs_nothing(shape: tuple[int, ...], tmp_path: Path) -> None:
    volume = write_zarr(tmp_path / "v.zarr", shape=shape, chunks=[1, 1, 1])
    assert (volume / ".zarray").stat().st_size < 200
    started, before = time.perf_counter(), peak()
    with pytest.raises(ReadError, match="stores 0 bytes for it; 256 MiB or 200 times that"):
        tk.load(volume)
    assert time.perf_counter() - started < 5
    assert peak() - before < 1 << 28


def test_a_shard_holds_no_more_chunks_than_its_index_has_room_for(tmp_path: Path) -> None:
    stored = zarr.create_array(
        tmp_path / "v.zarr", shape=(64, 64, 64), chunks=(8, 8, 8), shards=(64, 64, 64), dtype="u1"
    )
    stored[:8, :8, :8] = 1
    assert opened(tmp_path / "v.zarr").whole().sum() == 512
    about = json.loads((tmp_path / "v.zarr" / "zarr.json").read_text())
    about["shape"] = about["chunk_grid"]["configuration"]["chunk_shape"] = [80_000] * 3
    (tmp_path / "v.zarr" / "zarr.json").write_text(json.dumps(about))
    with pytest.raises(ReadError, match="announces an array of 512000000000000 bytes"):
        tk.load(tmp_path / "v.zarr")


def test_sparse_volumes_of_honest_size_are_read(tmp_path: Path) -> None:
    """One chunk of 4096 is stored; and of many more, when the volume has no more than 256 MiB."""
    with h5py.File(tmp_path / "v.h5", "w") as file:
        found = file.create_dataset("raw", (64,) * 3, "u1", chunks=(4,) * 3, compression="gzip")
        found[:3, :3, :3] = 1
    stored = zarr.create_array(tmp_path / "v.zarr", shape=(640,) * 3, chunks=(64,) * 3, dtype="u1")
    stored[:64, :64, :64] = 1
    assert tk.load(tmp_path / "v.h5").report().euler == 2
    assert opened(tmp_path / "v.zarr").shape == (640, 640, 640)


def test_short_chunks_are_taken_together() -> None:
    lengths = _lengths(1, 10**9 + 1)
    assert len(lengths) <= 1 << 20
    assert sum(lengths) == 10**9 + 1
    assert _lengths(3, 10) == (3, 3, 3, 1)


def test_memory_that_a_chunk_does_not_get_is_an_error_about_the_file() -> None:
    class Greedy:
        shape, dtype, chunks = (4, 4, 4), np.dtype("u1"), (4, 4, 4)

        def __getitem__(self, _: object) -> Any:
            raise MemoryError

    with pytest.raises(ReadError, match="MemoryError"):
        IndexedVolume(Greedy()).whole()
