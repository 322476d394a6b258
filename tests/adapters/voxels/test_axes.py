"""Arrays as writers produce them: times and channels of length one, units, coordinates, labels of 64 bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
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


def test_one_of_several_channels_is_the_volume(tmp_path: Path) -> None:
    both = np.stack((np.ones_like(RING), RING), axis=1)  # (z, c, y, x)
    np.save(tmp_path / "both.npy", both)
    mapped = np.load(tmp_path / "both.npy", mmap_mode="r")
    for source in (both, torch.from_numpy(both), tmp_path / "both.npy", mapped, both[None]):
        axis = np.ndim(source) - 3 if hasattr(source, "ndim") else 1
        for channel, tunnels in enumerate((0, 1)):
            assert tk.from_voxels(source, axis=axis, channel=channel).report().solid_betti == (1, tunnels, 0)
    for more in ({}, {"block_voxels": 60}):
        options = {"axis": -3, "channel": 1, **more}
        assert tk.from_voxels(both, **options).report().solid_betti == (1, 1, 0)
        assert tk.from_labels(tmp_path / "both.npy", **options)[1].report().solid_betti == (1, 1, 0)
    found = CliRunner().invoke(app, ["genus", str(tmp_path / "both.npy"), "--axis", "1", "--channel", "1"])
    assert found.stdout.startswith("1\t")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"axis": "t"}, "needs channel"),
        ({"channel": 0}, "which axis"),
        ({"axis": "t", "channel": 0}, "no axis 't'"),
        ({"axis": 7, "channel": 0}, "no axis 7"),
        ({"axis": 1, "channel": 2}, "no channel 2"),
        ({}, "pass axis=… and channel=…"),
    ],
)
def test_channels_that_are_not_there_are_refused(options: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        tk.from_voxels(np.ones((5, 2, 8, 9)), **options)


@pytest.mark.parametrize("version", ["0.4", "0.5"])
@pytest.mark.parametrize("n_channels", [1, 2])
def test_ome_zarr_with_a_time_and_channels(n_channels: int, version: str, tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr", reason="zarr is not installed; make test installs it")
    axes = [{"name": "t", "type": "time", "unit": "second"}, {"name": "c", "type": "channel"}]
    axes += [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    changes = [
        {"type": "scale", "scale": [60, 1, 2.0, 0.5, 0.25]},
        {"type": "translation", "translation": [0, 0, 10.0, 20.0, 30.0]},
    ]
    image = {"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": changes}]}
    group = zarr.open_group(tmp_path / "image.zarr", mode="w", zarr_format=2 if version == "0.4" else 3)
    pixels = np.zeros((1, n_channels, *RING.shape), np.uint8)
    pixels[0, -1] = RING
    group.create_array("0", data=pixels, chunks=(1, 1, 3, 3, 3))
    group.attrs.update({"multiscales": [image]} if version == "0.4" else {"ome": {"multiscales": [image]}})
    chosen = {} if n_channels == 1 else {"channel": 1}
    for options in (chosen, {"block_voxels": 60, "axis": "c", "channel": n_channels - 1}):
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
    both = xarray.concat([array, array * 0], "t")
    assert tk.load(both, axis="t", channel=0).report().placement == placement
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
