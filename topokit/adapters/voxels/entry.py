"""How volumes are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import os
import re
from pathlib import Path

from topokit.inputs.files import head
from topokit.inputs.numpy_header import numpy_kind
from topokit.plugins.adapter import Adapter

NRRD = b"NRRD0"
HDF5 = b"\x89HDF\r\n\x1a\n"
_ZARR = ("zarr.json", ".zarray", ".zgroup")  # a folder with one of these is an array or a group, of version 3 or 2
ADDRESSES = (".zarr",)
_LOOKED_AT = 16  # files of a folder
TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")


def is_volume(source: Path) -> bool:
    """Whether the content is a volume: NIfTI, NRRD, TIFF, MetaImage, HDF5, zarr, DICOM, or a 3-D NumPy array."""
    if source.is_dir():
        return is_zarr(source) or _holds_dicom(source)
    start = head(source)
    if start.startswith((NRRD, HDF5, *TIFF)) or is_dicom(start) or is_metaimage(start):
        return True
    return is_nifti(start) or numpy_kind(source, start) == "volume"


def is_zarr(folder: Path) -> bool:
    """Whether a folder is a zarr array or group."""
    return any((folder / name).is_file() for name in _ZARR)


def is_nifti(start: bytes) -> bool:
    """Whether an unpacked file that begins with these bytes is NIfTI 1 or 2."""
    return start[344:347] in (b"n+1", b"ni1") or start[4:7] == b"n+2"


def is_dicom(start: bytes) -> bool:
    """Whether a file that begins with these bytes is DICOM."""
    return start[128:132] == b"DICM"


def is_metaimage(start: bytes) -> bool:
    """Whether a file that begins with these bytes is a MetaImage (.mha, or the header .mhd)."""
    is_image = re.match(rb"\s*(ObjectType\s*=\s*Image|NDims\s*=)", start) is not None
    return is_image and b"DimSize" in start and b"ElementDataFile" in start


def _holds_dicom(folder: Path) -> bool:
    """Whether one of the first files of a folder is DICOM; a meta.json or an unreadable folder is another's."""
    try:
        names = sorted(os.listdir(folder))[:_LOOKED_AT]
        return any(is_dicom(head(folder / name, 132)) for name in names if (folder / name).is_file())
    except OSError:
        return False


VOXELS = Adapter(
    name="voxels",
    description="volumes, binary or gray; of DICOM also the folder of a series; zarr and HDF5 of any size",
    suffixes=(
        *(".nii", ".nii.gz", ".img", ".nrrd", ".nhdr", ".mha", ".mhd", ".dcm"),
        *(".tif", ".tiff", ".npy", ".npz", ".zarr", ".h5", ".hdf5"),
    ),
    can_open=is_volume,
    types=(
        *("nibabel.spatialimages.SpatialImage", "SimpleITK.Image", "monai.data.MetaTensor"),
        *("zarr.Array", "h5py.Dataset", "dask.array.Array"),
    ),
    extra="topokit[volumes]",
    suffix_requires=(
        *((suffix, "nibabel") for suffix in (".nii", ".nii.gz", ".img")),
        *((suffix, "tifffile") for suffix in (".tif", ".tiff")),
        *((suffix, "nrrd") for suffix in (".nrrd", ".nhdr")),
        *((suffix, "SimpleITK") for suffix in (".mha", ".mhd", ".dcm")),
        (".zarr", "zarr"),
        *((suffix, "h5py") for suffix in (".h5", ".hdf5")),
    ),
    opener="topokit.adapters.voxels.adapter:from_voxels",
    addresses=ADDRESSES,
    open_labels="topokit.adapters.voxels.labels:from_labels",
    is_large="topokit.adapters.voxels.large:is_large",
)
