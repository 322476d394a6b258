"""Volumes in HDF5 files of any size, held against what is stored; other files that they name are not opened."""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from topokit.adapters.voxels.announced_sizes import check_chunks
from topokit.adapters.voxels.chosen_part import ALL, Entry, chosen_array
from topokit.adapters.voxels.stored_volumes import StoredVolume, Values, contiguous
from topokit.core.blocks.division import Box
from topokit.core.grid.placement import Placement
from topokit.errors import ReadError, requiring
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_bytes


class HdfVolume(StoredVolume):
    """A data set in an HDF5 file; other processes open the file for themselves."""

    def __init__(
        self, dataset: Any, name: str = "voxels", placement: Placement | None = None, entry: Entry = ALL
    ) -> None:
        """Args: an `h5py.Dataset`, what to call it, where its voxels are, if known, and which part is the volume."""
        shape, names = dataset.shape or (), tuple(axis.label for axis in dataset.dims if axis.label)
        super().__init__(
            name, shape, dataset.dtype, dataset.chunks or contiguous(shape), entry, names * (len(names) == len(shape))
        )
        self.placement = placement
        self._path, self._place, self._dataset = Path(dataset.file.filename).absolute(), dataset.name, dataset

    def read(self, box: Box) -> Values:
        """See `StoredVolume`."""
        with reading(self._path, "h5py", MemoryError):
            if self._dataset is None:
                import h5py

                self._dataset = h5py.File(self._path, "r")[self._place]
            return np.asarray(self._dataset[self._slices(box)])

    def __getstate__(self) -> dict[str, Any]:
        """What is sent to another process: all but the open file."""
        return vars(self) | {"_dataset": None}


def hdf_volume(path: Path, entry: Entry) -> StoredVolume:
    """The volume in a file, or the one that the data set names."""
    with requiring('Reading .h5 needs h5py: pip install "topokit[cluster]".'):
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
    if sizes is None or len(sizes) != 3:
        return HdfVolume(found, path.name, None, entry)
    x, y, z = map(float, sizes)
    return HdfVolume(found, path.name, Placement((x, y, z), unit="µm"), entry)


def check_hdf(path: Path, dataset: Any) -> None:
    """Refuse an `h5py.Dataset` whose values are in other files, or that announces far more than is stored.

    Raises:
        ReadError: if it is one.
    """
    others = [name for name, *_ in dataset.external or ()]
    if dataset.is_virtual:
        others = [source.file_name for source in dataset.virtual_sources()]
    if others or dataset.is_virtual:
        names = ", ".join(map(repr, sorted(set(others)))) or "other data sets"
        raise ReadError(f"{path} keeps the values of {dataset.name} in {names}; only the given file is opened.")
    packed = dataset.id.get_storage_size()
    require_bytes(path, f"the values of {dataset.name}", packed, path.stat().st_size)
    if dataset.chunks is None:
        check_chunks(path, dataset.nbytes, 0, packed, packed)
    else:
        itemsize = dataset.dtype.itemsize
        announced, chunk = prod(map(int, dataset.shape)) * itemsize, prod(dataset.chunks) * itemsize
        check_chunks(path, announced, chunk, dataset.id.get_num_chunks() * chunk, packed)
