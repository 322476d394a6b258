"""Arrays as writers produce them: times and channels of length one, units, coordinates, labels of 64 bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.errors import InputError

RING = np.zeros((5, 8, 9), np.uint8)
RING[1:4, 1:7, 1:8] = 1
RING[:, 3:5, 3:6] = 0


@pytest.mark.parametrize("shape", [(1, 5, 8, 9), (5, 8, 9, 1), (1, 1, 5, 8, 9), (1, 5, 8, 9, 1)])
def test_axes_of_length_one_are_left_out(shape: tuple[int, ...], tmp_path: Path) -> None:
    array = RING.reshape(shape)
    np.save(tmp_path / "ring.npy", array)
    np.savez(tmp_path / "other.npz", array)
    for source in (
        array,
        torch.from_numpy(array),
        tmp_path / "ring.npy",
        np.load(tmp_path / "ring.npy", mmap_mode="r"),
    ):
        report = tk.from_voxels(source).report()
        assert report.solid_betti == (1, 1, 0)
    assert tk.from_voxels(tmp_path / "ring.npy", block_voxels=60).report().solid_betti == (1, 1, 0)
    thin = tk.from_voxels(np.ones((1, 1, 1, 4, 4), bool))
    assert thin.field.grid.shape == (1, 4, 4)  # a single slice of a time and a channel


def test_several_channels_are_refused() -> None:
    for shape in ((2, 5, 8, 9), (2, 1, 5, 8, 9), (3, 4)):
        with pytest.raises(InputError, match=r"shape \(X, Y, Z\)"):
            tk.from_voxels(np.ones(shape))


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_ome_zarr_with_a_time_and_a_channel(version: str, tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr", reason="zarr is not installed; make test installs it")
    axes = [{"name": "t", "type": "time", "unit": "second"}, {"name": "c", "type": "channel"}]
    axes += [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    changes = [
        {"type": "scale", "scale": [60, 1, 2.0, 0.5, 0.25]},
        {"type": "translation", "translation": [0, 0, 10.0, 20.0, 30.0]},
    ]
    image = {"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": changes}]}
    group = zarr.open_group(tmp_path / "image.zarr", mode="w", zarr_format=2 if version == "0.4" else 3)
    group.create_array("0", shape=(1, 1, *RING.shape), chunks=(1, 1, 3, 3, 3), dtype="u1")[:] = RING[None, None]
    group.attrs.update({"multiscales": [image]} if version == "0.4" else {"ome": {"multiscales": [image]}})
    for options in ({}, {"block_voxels": 60}):
        report = tk.load(tmp_path / "image.zarr", **options).report(locate=True)
        placement = report.placement
        assert (report.solid_betti, placement.spacing, placement.unit) == ((1, 1, 0), (2, 0.5, 0.25), "µm")
        assert placement.world((2.0, 0.5, 0.25)) == (12, 20.5, 30.25)


def test_xarray_brings_its_coordinates() -> None:
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    ticks = {"z": 9 - 2.0 * np.arange(5), "y": 0.5 * np.arange(8), "x": 3 + 0.5 * np.arange(9)}
    coords = {name: (name, values, {"units": "mm"}) for name, values in ticks.items()}
    array = xarray.DataArray(RING[None], dims=("t", "z", "y", "x"), coords=coords)
    placement = tk.load(array).report().placement
    assert (placement.spacing, placement.unit) == ((2, 0.5, 0.5), "mm")
    assert placement.world((4.0, 1.0, 0.5)) == (5, 1, 3.5)  # the third slice, which lies below the first one
    lazy = tk.load(array.chunk({"z": 2}), block_voxels=60).report()
    assert (lazy.placement, lazy.solid_betti) == (placement, (1, 1, 0))
    uneven = array.assign_coords(z=("z", [0.0, 1, 2, 4, 5]))
    with pytest.raises(InputError, match="'z' are not evenly spaced"):
        tk.from_voxels(uneven)
    assert tk.from_voxels(xarray.DataArray(RING)).report().placement.spacing == (1, 1, 1)


def test_labels_of_64_bits_are_counted_in_memory() -> None:
    labels = RING.astype(np.uint64) << np.uint64(62)
    assert tk.from_voxels(labels, label=2**62).report().solid_betti == (1, 1, 0)
    assert tk.from_labels(labels)[2**62].report().solid_betti == (1, 1, 0)
    with pytest.raises(InputError, match="2⁶³"):
        tk.from_voxels(labels * np.uint64(2), label=2**63)
