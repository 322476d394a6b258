"""Files of volumes that can be read box by box: zarr, HDF5, and .npy as a memory map."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from torch import Tensor

from topokit.adapters.voxels.entry import ADDRESSES, FORMATS
from topokit.adapters.voxels.stored import (
    ALL,
    Entry,
    HdfVolume,
    IndexedVolume,
    MappedVolume,
    StoredVolume,
    axis_names,
    in_memory_array,
    stored_array,
    volume_axes,
)
from topokit.adapters.voxels.stored_extent import check_hdf, check_remote_zarr, check_zarr, refuse_links
from topokit.core.arrays import Floats
from topokit.core.grid.placement import Placement
from topokit.errors import InputError, Option, ReadError, requiring
from topokit.inputs.files import existing_file, user_path
from topokit.inputs.formats import stored_in
from topokit.inputs.headers import array_shapes
from topokit.inputs.reading import reading
from topokit.inputs.remote import asking, lies_in

_HOW = 'pip install "topokit[cluster]"'
_UNITS = {"meter": "m", "millimeter": "mm", "micrometer": "µm", "nanometer": "nm", "angstrom": "Å"}  # of OME-Zarr


def stored_volume(volume: object, entry: Entry = ALL) -> StoredVolume | None:
    """A volume that can be read box by box; None for what other readers read as a whole, or is in memory already.

    Args:
        volume: a path or an array.
        entry: which part of it is the volume.

    Raises:
        ReadError: if a file is missing or malformed, or has no such array.
        MissingDependencyError: if the package for its format is not installed.
        InputError: if there is no volume, or several and no `dataset`; or there is a `dataset`, but nothing to hold it.
    """
    if isinstance(volume, str) and lies_in(volume, ADDRESSES):
        found: StoredVolume | None = zarr_volume(volume, entry)
    elif isinstance(volume, str | os.PathLike):
        path = user_path(volume)
        found = stored_in(FORMATS, path if path.is_dir() else existing_file(path), entry)
    else:
        found = stored_array(volume, entry)
    if entry.dataset is not None and (found is None or isinstance(found, MappedVolume)):
        named = Option("dataset", repr(entry.dataset))
        raise InputError(named, " names an array in a zarr group, HDF5 or VTK file; this is none of them.")
    return found


def readable_in_blocks(volume: Any, entry: Entry = ALL) -> StoredVolume:
    """An array or tensor in memory, to be read box by box all the same.

    Raises:
        InputError: if it is a file that can be read only as a whole.
    """
    if isinstance(volume, str | os.PathLike):
        raise InputError(
            f"{volume} can be read only as a whole. Convert it to .zarr, .h5 or .npy, or open it and pass the array.",
            file=volume,
        )
    return in_memory_array(volume if isinstance(volume, Tensor) else np.asanyarray(volume), entry)


def npy_volume(path: Path, entry: Entry) -> StoredVolume | None:
    """An array of three axes as a memory map; there is no data set to choose."""
    shape = array_shapes(path).get("", ())
    if len(volume_axes(shape, entry.chosen(shape, ()))) != 3:
        return None
    with reading(path, "the NumPy reader"):
        return MappedVolume(np.load(path, mmap_mode="r", allow_pickle=False), path.name, entry)


def zarr_volume(path: Path | str, entry: Entry) -> StoredVolume:
    """The volume in a folder or at an address."""
    name = PurePosixPath(path).name
    with requiring(f"Reading .zarr needs zarr: {_HOW}."):
        import zarr
        from zarr.errors import BaseZarrError
    placement: Placement | None = None
    names: tuple[str, ...] = ()
    with asking(path) if isinstance(path, str) else reading(path, "zarr", BaseZarrError, LookupError, TypeError):
        if isinstance(path, Path):
            refuse_links(path)
        found: Any = zarr.open(path, mode="r")
        if isinstance(found, zarr.Group):
            arrays = {
                name: part for name, part in sorted(found.members(max_depth=None)) if isinstance(part, zarr.Array)
            }
            shapes = {name: one.shape for name, one in arrays.items()}
            names, levels = _levels(found)
            chosen = chosen_array(path, shapes, entry._replace(dataset=entry.dataset or next(iter(levels), None)))
            names = names if chosen in levels else ()
            found, placement = arrays[chosen], levels.get(chosen)
        if isinstance(path, str):
            check_remote_zarr(path, found)
        else:
            check_zarr(path, found)
    return IndexedVolume(found, name, placement, entry, names or axis_names(found))


def _levels(group: Any) -> tuple[tuple[str, ...], dict[str, Placement | None]]:
    """The names of the axes of an OME-Zarr image, and its levels, finest first: paths, and where their voxels are.

    Of other groups there are none.

    Reference:
        J. Moore et al., "OME-Zarr: a cloud-optimized bioimaging file format with international community support",
        2023, doi:10.1007/s00418-023-02209-1.
    """
    attributes = dict(group.attrs)
    images = attributes.get("ome", attributes).get("multiscales") or [{}]
    axes = [axis if isinstance(axis, dict) else {} for axis in images[0].get("axes", ())]
    spatial = [number for number, axis in enumerate(axes) if axis.get("type", "space") == "space"]
    units = [axes[number].get("unit", "") for number in spatial]
    found: dict[str, Placement | None] = {}
    for level in images[0].get("datasets", ()):
        given = {one.get("type"): one for one in level.get("coordinateTransformations", ())}
        scale, first = (np.asarray(given.get(name, {}).get(name, ()), dtype=float) for name in ("scale", "translation"))
        if len(scale) == len(axes):
            scale, first = scale[spatial], first[spatial] if len(first) == len(axes) else first
        found[level["path"]] = _ome_placement(scale, first, units)
    return tuple(str(axis.get("name", "")) for axis in axes), found


def _ome_placement(scale: Floats, first: Floats, units: Sequence[str]) -> Placement | None:
    """Where voxels are by their sizes, the center of the first one and the units; None unless there are three axes."""
    if len(scale) != 3:
        return None
    unit = _UNITS.get(units[-1], units[-1]) if len(set(units)) == 1 else ""
    if len(first) != 3:
        return Placement(_triple(scale), unit=unit)
    affine = np.diag([*scale, 1.0])
    affine[:3, 3] = first
    return Placement.of_affine(affine, unit)


def _triple(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def hdf_volume(path: Path, entry: Entry) -> StoredVolume:
    """The volume in a file, or the one that the data set names."""
    with requiring(f"Reading .h5 needs h5py: {_HOW}."):
        import h5py
    shapes: dict[str, tuple[int, ...]] = {}

    def note(name: str, found: Any) -> None:
        if isinstance(found, h5py.Dataset):
            shapes[name] = found.shape or ()

    with reading(path, "h5py", LookupError, RuntimeError):
        file = h5py.File(path, "r")  # stays open as long as the volume needs it
        file.visititems(note)
        found = file[chosen_array(path, shapes, entry)]
        check_hdf(path, found)
        sizes = found.attrs.get("element_size_um")  # as ilastik and its kin write it
    told = sizes is not None and len(sizes) == 3
    return HdfVolume(found, path.name, Placement(_triple(sizes), unit="µm") if told else None, entry)


def chosen_array(path: Path | str, shapes: dict[str, tuple[int, ...]], entry: Entry) -> str:
    """The path of the array that is wanted, or of the only volume."""
    dataset = entry.dataset
    if dataset is not None and dataset.strip("/") in shapes:
        return dataset.strip("/")
    volumes = [name for name, shape in shapes.items() if len(volume_axes(shape)) == 3 + (entry.channel is not None)]
    if dataset is None and len(volumes) == 1:
        return volumes[0]
    held = ", ".join(_described(shapes)) or "no array"
    if dataset is not None:
        raise ReadError(f"{path} has no array {dataset!r}. It holds {held}.")
    wanted = "pass ", Option("dataset", "…"), ", the path of an array with three axes."
    raise InputError(f"{path} holds {held}: ", *wanted, file=path)


def _described(shapes: dict[str, tuple[int, ...]], most: int = 10) -> Iterator[str]:
    for number, (name, shape) in enumerate(shapes.items()):
        if number == most:
            yield f"and {len(shapes) - most} more"
            return
        yield f"{name} {shape}"
