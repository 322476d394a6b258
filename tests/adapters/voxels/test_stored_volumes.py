"""Stored volumes: zarr, HDF5, memory maps and Dask arrays give the report of the same volume in memory."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import topokit as tk
from topokit.adapters.voxels import larger_than_memory
from topokit.adapters.voxels.opening_stored import stored_array
from topokit.errors import InputError, ReadError

zarr = pytest.importorskip("zarr")
h5py = pytest.importorskip("h5py")
dask_array = pytest.importorskip("dask.array")

Make = Callable[[Path, NDArray[Any]], Any]


def volume(kind: str = "uint8") -> NDArray[Any]:
    """Noise with cavities, cut by the border."""
    return ((np.random.default_rng(0).random((19, 23, 21)) < 0.6) * 7).astype(kind)


def zarr_path(folder: Path, values: NDArray[Any]) -> Path:
    stored = zarr.create_array(folder / "v.zarr", shape=values.shape, chunks=(8, 5, 21), dtype=values.dtype)
    stored[:] = values
    return folder / "v.zarr"


def sharded(values: NDArray[Any]) -> Any:
    stored = zarr.create_array({}, shape=values.shape, chunks=(4, 5, 7), shards=(8, 10, 14), dtype=values.dtype)
    stored[:] = values
    return stored


def hdf_path(folder: Path, values: NDArray[Any]) -> Path:
    with h5py.File(folder / "v.h5", "w") as file:
        file.create_dataset("group/raw", data=values, chunks=(4, 23, 7))
        file.create_dataset("names", data=np.arange(3))
    return folder / "v.h5"


def npy_path(folder: Path, values: NDArray[Any]) -> Path:
    np.save(folder / "v.npy", values)
    return folder / "v.npy"


def mapped(folder: Path, values: NDArray[Any]) -> Any:
    return np.load(npy_path(folder, values), mmap_mode="r")


def n5_array(folder: Path, values: NDArray[Any]) -> Any:
    """An array in the N5 format, opened by TensorStore."""
    tensorstore = pytest.importorskip("tensorstore")
    store = {"driver": "file", "path": str(folder / "v.n5")}
    metadata = {"dataType": str(values.dtype), "dimensions": values.shape, "blockSize": [8, 5, 21]}
    metadata["compression"] = {"type": "gzip"}
    stored = tensorstore.open({"driver": "n5", "kvstore": store, "metadata": metadata, "create": True}).result()
    stored[...] = values
    return stored


KINDS: dict[str, Make] = {
    "zarr path": zarr_path,
    "zarr array": lambda folder, values: zarr.open(zarr_path(folder, values), mode="r"),
    "sharded zarr": lambda folder, values: sharded(values),
    "HDF5 path": hdf_path,
    "HDF5 data set": lambda folder, values: h5py.File(hdf_path(folder, values))["group/raw"],
    "npy path": npy_path,
    "memory map": mapped,
    "memory map in Fortran order": lambda folder, values: mapped(folder, np.asfortranarray(values)),
    "slice of a memory map": lambda folder, values: mapped(folder, np.pad(values, 2))[2:-2, 2:-2, 2:-2],
    "Dask array": lambda folder, values: dask_array.from_array(values, chunks=((9, 10), (23,), (4, 8, 9))),
    "N5 of TensorStore": n5_array,
    "array": lambda folder, values: values,
}


def same(one: tk.TopologyReport, other: tk.TopologyReport) -> bool:
    return (one.euler, one.reasons, one.per_component) == (other.euler, other.reasons, other.per_component)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_gives_the_report_of_the_array(kind: str, tmp_path: Path) -> None:
    source = KINDS[kind](tmp_path, volume())
    place = {"spacing": (1, 2, 0.5), "origin": (3, 0, -1)}
    expected = tk.from_voxels(volume(), **place).report()
    assert expected.verdict == "certain"
    for options in ({}, {"block_voxels": 700}, {"block_voxels": 10**9}):
        assert same(tk.from_voxels(source, **place, **options).report(), expected)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.startswith(("zarr array", "HDF", "Dask"))])
def test_load_takes_stored_arrays(kind: str, tmp_path: Path) -> None:
    assert same(tk.load(KINDS[kind](tmp_path, volume())).report(), tk.from_voxels(volume()).report())


@pytest.mark.parametrize("options", [{"level": 3.5}, {"label": 7}, {"label": 0}, {"connectivity": 6}])
@pytest.mark.parametrize("kind", ["uint8", "int16", ">u2", "uint32", "float32", "float64"])
def test_options_and_types(kind: str, options: dict[str, Any], tmp_path: Path) -> None:
    stored = zarr.open(zarr_path(tmp_path, volume(kind)))
    expected = tk.from_voxels(volume(kind), **options).report()
    found = tk.from_voxels(stored, block_voxels=900, **options).report()
    assert same(found, expected)


def test_labels_that_floats_do_not_tell_apart() -> None:
    labels = np.full((4, 4, 4), 2**63 + 1, np.uint64)
    labels[1:3, 1:3, 1:3] = 2**63 + 2
    assert tk.from_voxels(labels, label=2**63 + 1, block_voxels=20).report().solid_betti == (1, 0, 1)


def test_nan_is_background_and_counted() -> None:
    values = volume("float32")
    values[3:5, 4:6, 7] = np.nan
    found = tk.from_voxels(values, level=1, block_voxels=300).report()
    assert same(found, tk.from_voxels(values, level=1).report())
    assert "NaN counts as background, in 4 voxels." in found.reasons


@pytest.mark.parametrize(
    ("values", "options", "message"),
    [
        (np.arange(64.0).reshape(4, 4, 4), {}, "more than the two values of a binary one, from 0 to 63"),
        (np.array([[[0, 3, 5]]]), {}, "from 0 to 5"),
        (np.array([[[-1, 0]]]), {}, "from -1 to 0"),
        (np.zeros((2, 3, 4)), {}, "no voxel is above"),
        (np.ones((2, 3, 4)), {"level": 1}, "no voxel is above the level 1: the volume's values go from 1 to 1"),
        (np.ones((2, 3, 4)), {"label": 2}, "no voxel equals the label 2"),
        (np.full((2, 3, 4), np.nan), {"level": 1}, "all voxels are NaN"),
    ],
)
def test_values_that_do_not_fit_are_refused_as_in_memory(
    values: NDArray[Any], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        tk.from_voxels(values, **options).report()
    with pytest.raises(InputError, match=message):
        tk.from_voxels(values, block_voxels=2, **options).report()


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.endswith("path") and kind != "array"])
def test_other_processes_read_the_same(kind: str, tmp_path: Path) -> None:
    stored = stored_array(KINDS[kind](tmp_path, volume()))
    assert stored is not None
    sent = pickle.loads(pickle.dumps(stored.at(((2, 9), (0, 23), (5, 6)))))
    assert (np.asarray(sent() if callable(sent) else sent) == volume()[2:9, :, 5:6]).all()


def test_the_voxel_sizes_of_an_hdf_file_are_used(tmp_path: Path) -> None:
    with h5py.File(hdf_path(tmp_path, volume()), "r+") as file:
        file["group/raw"].attrs["element_size_um"] = (2.0, 1.0, 0.5)
    expected = tk.from_voxels(volume(), spacing=(2, 1, 0.5)).report()
    for options in ({}, {"block_voxels": 500}):
        assert same(tk.load(tmp_path / "v.h5", **options).report(), expected)


def test_a_data_set_that_is_being_written_is_read(tmp_path: Path) -> None:
    with h5py.File(hdf_path(tmp_path, volume()), "r+") as file:
        file["group/raw"][0] = 7
        changed = volume()
        changed[0] = 7
        found = tk.from_voxels(file["group/raw"], block_voxels=500).report()
        assert same(found, tk.from_voxels(changed).report())


def test_large_volumes_are_read_block_by_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = zarr_path(tmp_path, volume())
    expected = tk.from_voxels(path)
    assert len(expected.curvature().gaussian) > 0
    monkeypatch.setattr(larger_than_memory, "MOST_IN_MEMORY", volume().size - 1)
    shape = tk.load(path)
    assert same(shape.report(), expected.report())
    for ask in (shape.curvature, shape.surface):
        with pytest.raises(InputError, match=r"v\.zarr is counted block by block.* Open a part"):
            ask()


def test_no_block_is_read_twice_nor_held(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[tuple[slice, ...]] = []

    class Watched:
        shape, dtype, chunks = volume().shape, volume().dtype, (5, 6, 7)

        def __getitem__(self, box: tuple[slice, ...]) -> NDArray[Any]:
            read.append(box)
            return volume()[box]

    report = tk.from_voxels(Watched(), block_voxels=300).report()
    assert report.euler == tk.from_voxels(volume()).report().euler
    seen = np.zeros(volume().shape, int)
    for box in read:
        seen[box] += 1
    assert (seen == 1).all()
    assert max(np.prod([side.stop - side.start for side in box]) for box in read) <= 420


def test_groups_and_images_of_several_levels(tmp_path: Path) -> None:
    group = zarr.create_group(tmp_path / "image.zarr")
    for level, step in (("0", 1), ("1", 2)):
        values = volume()[::step, ::step, ::step]
        group.create_array(level, shape=values.shape, chunks=(8, 8, 8), dtype=values.dtype)[:] = values
    with pytest.raises(InputError, match=r"0 \(19, 23, 21\), 1 \(10, 12, 11\): pass dataset="):
        tk.load(tmp_path / "image.zarr")
    one = tk.load(tmp_path / "image.zarr", dataset="1").report()
    assert one.euler == tk.from_voxels(volume()[::2, ::2, ::2]).report().euler
    levels = [
        {"path": name, "coordinateTransformations": [{"type": "scale", "scale": [step, 0.5 * step, 2 * step]}]}
        for name, step in (("0", 1), ("1", 2))
    ]
    group.attrs["ome"] = {"multiscales": [{"datasets": levels}]}
    for options in ({}, {"block_voxels": 500}):
        finest = tk.load(tmp_path / "image.zarr", **options).report()
        assert same(finest, tk.from_voxels(volume(), spacing=(1, 0.5, 2)).report())
        coarse = tk.load(tmp_path / "image.zarr", dataset="1", **options).report()
        assert same(coarse, tk.from_voxels(volume()[::2, ::2, ::2], spacing=(2, 1, 4)).report())
    with pytest.raises(ReadError, match="no array 'masks'"):
        tk.load(hdf_path(tmp_path, volume()), dataset="masks")
    with pytest.raises(InputError, match="names an array in a zarr group, HDF5 or VTK file"):
        tk.load(npy_path(tmp_path, volume()), dataset="raw")


def test_damaged_files_are_read_errors(tmp_path: Path) -> None:
    for path in (hdf_path(tmp_path, volume()), tmp_path / "half.h5"):
        (tmp_path / "half.h5").write_bytes(path.read_bytes()[:700])
    with pytest.raises(ReadError, match=r"half\.h5 could not be read by h5py"):
        tk.load(tmp_path / "half.h5")
    folder = zarr_path(tmp_path, volume())
    next(path for path in sorted((folder / "c").rglob("*")) if path.is_file()).write_bytes(b"no zstd")
    for options in ({}, {"block_voxels": 900}):
        with pytest.raises(ReadError, match=r"v\.zarr could not be read"):
            tk.load(folder, **options).report()
    (folder / "zarr.json").write_text("{")
    with pytest.raises(ReadError, match="zarr"):
        tk.load(folder)


def test_what_is_no_volume_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"shape \(X, Y, Z\), got \(3, 4\)"):
        tk.from_voxels(zarr.zeros((3, 4)))
    with pytest.raises(InputError, match="real numbers, got complex"):
        tk.from_voxels(zarr.zeros((3, 4, 5), dtype="complex64"))
    unknown = dask_array.from_array(np.arange(60), chunks=20)
    with pytest.raises(InputError, match=r"got \(nan"):
        tk.from_voxels(unknown[unknown > 3][:, None, None])
    with pytest.raises(InputError, match="block_voxels must be at least 1"):
        tk.from_voxels(volume(), block_voxels=0)
    (tmp_path / "v.nrrd").write_bytes(b"NRRD0004\n")
    with pytest.raises(InputError, match="only as a whole"):
        tk.from_voxels(tmp_path / "v.nrrd", block_voxels=100)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_every_label_as_in_memory(connectivity: int, tmp_path: Path) -> None:
    labels = np.random.default_rng(2).integers(0, 4, (12, 14, 13)).astype("uint16")
    labels[labels == 3] = 40_000
    place = {"spacing": (1, 2, 0.5), "origin": (3, 0, -1), "connectivity": connectivity}
    expected = tk.from_labels(labels.astype("int32"), **place)
    for source in (zarr_path(tmp_path, labels), dask_array.from_array(labels, chunks=5), labels):
        found = tk.from_labels(source, block_voxels=200, **place)
        assert list(found) == list(expected) == [1, 2, 40_000]
        for label, shape in found.items():
            assert shape.report().per_component == expected[label].report().per_component
            assert shape.name == expected[label].name.replace(
                "voxels", "v.zarr" if isinstance(source, Path) else "voxels"
            )
    several = {"label": [2, 40_000, 9], **place}
    assert same(
        tk.from_voxels(labels, block_voxels=200, **several).report(), tk.from_voxels(labels, **several).report()
    )
    with pytest.raises(InputError, match="no voxel has the label 7"):
        tk.from_labels(labels, [7], block_voxels=200)
    with pytest.raises(InputError, match="labels are whole numbers"):
        tk.from_labels(labels + 0.5, block_voxels=200)
