"""What is read box by box: paths and arrays of zarr, HDF5, Dask, xarray and memory maps as stored volumes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from torch import Tensor

from topokit.adapters.voxels.chosen_part import ALL, Entry, axis_names, volume_axes
from topokit.adapters.voxels.entry import ADDRESSES, FORMATS
from topokit.adapters.voxels.hdf_volumes import HdfVolume
from topokit.adapters.voxels.stored_volumes import DaskVolume, IndexedVolume, MappedVolume, MemoryVolume, StoredVolume
from topokit.adapters.voxels.zarr_volumes import zarr_volume
from topokit.core.grid.placement import Placement
from topokit.errors import InputError, Option
from topokit.inputs.arrays import as_tensor
from topokit.inputs.files import existing_file, user_path
from topokit.inputs.formats import stored_in
from topokit.inputs.remote import lies_in


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


def stored_array(volume: object, entry: Entry = ALL, names: Sequence[str] = ()) -> StoredVolume | None:
    """An array that can be read box by box; None for what is in memory already, or is no array.

    Args:
        volume: the array.
        entry: which part of it is the volume.
        names: of its axes, if it has none itself.
    """
    kind = type(volume).__module__.partition(".")[0]
    if kind == "xarray" and hasattr(volume, "coords"):
        array: Any = volume
        found = stored_array(array.data, entry, tuple(map(str, array.dims)))
        if found is not None:
            found.placement = placement_of_xarray(array, entry)
        return found
    if kind == "h5py" and hasattr(volume, "file"):
        return HdfVolume(volume, entry=entry)
    if kind == "dask" and hasattr(volume, "dask"):
        return DaskVolume(volume, entry=entry, names=names)
    if isinstance(volume, np.memmap):
        whole = volume.base is not None and not isinstance(volume.base, np.memmap) and volume.filename is not None
        is_plain = whole and volume.flags.forc
        return MappedVolume(volume, entry=entry) if is_plain else IndexedVolume(volume, entry=entry, names=names)
    is_array = hasattr(volume, "shape") and hasattr(volume, "dtype") and hasattr(volume, "__getitem__")
    if not is_array or isinstance(volume, np.ndarray | Tensor) or not _is_lazy(volume):
        return None
    return IndexedVolume(volume, entry=entry, names=names or axis_names(volume))


def placement_of_xarray(array: Any, entry: Entry = ALL) -> Placement | None:
    """Where the voxels of an `xarray.DataArray` are by the coordinates of its axes; None if an axis has none.

    Raises:
        InputError: if they are not evenly spaced.
    """
    chosen = entry.chosen(array.shape, tuple(map(str, array.dims)))
    names = [array.dims[axis] for axis in volume_axes(array.shape, chosen)]
    if len(names) != 3 or not all(name in array.coords and array.sizes[name] > 1 for name in names):
        return None
    ticks = [np.asarray(array.coords[name].values, dtype=float) for name in names]
    steps = [(one[-1] - one[0]) / (len(one) - 1) for one in ticks]
    for name, one, step in zip(names, ticks, steps, strict=True):
        if not np.allclose(np.diff(one), step, rtol=1e-3, atol=0):
            raise InputError(f"the coordinates along {name!r} are not evenly spaced: interpolate them first.")
    units = {str(array.coords[name].attrs.get("units", "")) for name in names}
    affine = np.diag([*steps, 1.0])
    affine[:3, 3] = [one[0] for one in ticks]
    return Placement.of_affine(affine, units.pop() if len(units) == 1 else "")


def in_memory_array(volume: object, entry: Entry = ALL) -> StoredVolume:
    """An array or tensor in memory, to be read box by box all the same."""
    return MemoryVolume(as_tensor(volume, "the volume", "(X, Y, Z)").detach().cpu().numpy(), entry=entry)


def _is_lazy(volume: object) -> bool:
    return hasattr(volume, "chunks") or hasattr(volume, "chunk_layout")
