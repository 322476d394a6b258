"""How volumes are recognized; nothing that reads them is imported here."""

from __future__ import annotations

from pathlib import Path

from topokit.inputs.files import head, unpacked_head
from topokit.inputs.numpy_header import numpy_kind
from topokit.plugins.adapter import Adapter

NRRD = b"NRRD0"
HDF5 = b"\x89HDF\r\n\x1a\n"
_ZARR = ("zarr.json", ".zarray", ".zgroup")  # a folder with one of these is an array or a group, of version 3 or 2
TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")


def is_volume(source: Path) -> bool:
    """Whether the content is a volume: NRRD, TIFF, HDF5, zarr, a 3-D NumPy array, or NIfTI, gzipped or not."""
    if source.is_dir():
        return is_zarr(source)
    start = head(source)
    if start.startswith((NRRD, HDF5, *TIFF)) or numpy_kind(source, start) == "volume":
        return True
    return is_nifti(unpacked_head(source))


def is_zarr(folder: Path) -> bool:
    """Whether a folder is a zarr array or group."""
    return any((folder / name).is_file() for name in _ZARR)


def is_nifti(start: bytes) -> bool:
    """Whether an unpacked file that begins with these bytes is NIfTI 1 or 2."""
    return start[344:347] in (b"n+1", b"ni1") or start[4:7] == b"n+2"


VOXELS = Adapter(
    name="voxels",
    description="volumes, binary or gray",
    suffixes=(".nii", ".nii.gz", ".nrrd", ".tif", ".tiff", ".npy", ".npz", ".zarr", ".h5", ".hdf5"),
    can_open=is_volume,
    extra="topokit[volumes]",
    suffix_requires=(
        *((suffix, "nibabel") for suffix in (".nii", ".nii.gz")),
        *((suffix, "tifffile") for suffix in (".tif", ".tiff")),
        (".nrrd", "nrrd"),
        (".zarr", "zarr"),
        *((suffix, "h5py") for suffix in (".h5", ".hdf5")),
    ),
    opener="topokit.adapters.voxels.adapter:from_voxels",
)
