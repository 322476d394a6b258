"""The formats of volumes, and how they are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import os
import re
from functools import partial
from pathlib import Path

from topokit.adapters.voxels.announced_sizes import page_count
from topokit.errors import ReadError
from topokit.inputs.files import BEGINNINGS, ZIP, head
from topokit.inputs.formats import Format, begins, is_certainly, requirements_of, suffixes_of
from topokit.inputs.headers import numpy_kind
from topokit.plugins.adapter import Adapter

ADDRESSES = (".zarr",)
_ZARR = ("zarr.json", ".zarray", ".zgroup")  # a folder with one of these is an array or a group, of version 3 or 2
_TIFF = (".tif", ".tiff")
_LOOKED_AT = 16  # files of a folder


def is_zarr(folder: Path) -> bool:
    """Whether a folder is a zarr array or group."""
    return any((folder / name).is_file() for name in _ZARR)


def is_nifti(path: Path, start: bytes) -> bool:
    """Whether an unpacked file that begins with these bytes is NIfTI 1 or 2, or an .img beside its header."""
    if path.suffix.lower() == ".img" and path.with_suffix(".hdr").is_file():
        start = head(path.with_suffix(".hdr"))
    return start[344:347] in (b"n+1", b"ni1") or start[4:7] == b"n+2"


def _is_mgh(path: Path, start: bytes) -> bool:
    """Whether a file begins with version 1 and a known type of voxels."""
    return start[:4] == b"\0\0\0\x01" and start[20:23] == b"\0\0\0" and start[23:24] in b"\0\x01\x03\x04\x0a"


def is_dicom(start: bytes) -> bool:
    """Whether a file that begins with these bytes is DICOM."""
    return start[128:132] == b"DICM"


def _is_metaimage(path: Path, start: bytes) -> bool:
    """Whether a file that begins with these bytes is a MetaImage (.mha, or the header .mhd)."""
    is_image = re.match(rb"\s*(ObjectType\s*=\s*Image|NDims\s*=)", start) is not None
    return is_image and b"DimSize" in start and b"ElementDataFile" in start


def _is_vti(path: Path, start: bytes) -> bool:
    """Whether this is XML of VTK with an image in it."""
    return re.search(rb"<VTKFile\b[^>]*\btype=[\"']ImageData[\"']", start[:4096]) is not None


def _is_dicom(folder: Path, start: bytes) -> bool:
    """Whether this is DICOM, or a folder of whose first files one is; a meta.json or an unreadable one is another's."""
    if not folder.is_dir():
        return is_dicom(start)
    try:
        names = sorted(os.listdir(folder))[:_LOOKED_AT]
        return any(is_dicom(head(folder / name, 132)) for name in names if (folder / name).is_file())
    except OSError:
        return False


def slice_files(folder: Path) -> list[Path]:
    """The files of a folder if all are .tif, apart from hidden ones; else none."""
    files = [path for path in folder.iterdir() if not path.name.startswith(".")]
    return files if all(path.suffix.lower() in _TIFF and path.is_file() for path in files) else []


def _is_slices(folder: Path, start: bytes) -> bool:
    """Whether this is a folder of several .tif files, the first of which has one page and no stack of ImageJ in it."""
    if not folder.is_dir():
        return False
    try:
        files = slice_files(folder)
        first = min(files, default=folder)
        return len(files) > 1 and page_count(first, most=2) == 1 and b"images=" not in head(first)
    except (OSError, ReadError):
        return False


def _is_volume(path: Path, beginning: bytes) -> bool:
    """Whether NumPy's arrays have three axes."""
    return numpy_kind(path, beginning) == "volume"


_HERE = "topokit.adapters.voxels"
_NUMPY = f"{_HERE}.numpy_volumes"
_ITK = f"{_HERE}.medical:read_itk"
FORMATS = (
    Format(
        *("NPY", (".npy",), begins(BEGINNINGS[".npy"]), f"{_NUMPY}:read_npy", f"{_NUMPY}:npy_volume"),
        is_certain=_is_volume,
    ),
    Format("NPZ", (".npz",), begins(ZIP), f"{_NUMPY}:read_npz", is_certain=_is_volume),
    Format("NIfTI", (".nii", ".nii.gz", ".img"), is_nifti, f"{_HERE}.medical:read_nifti", requires=("nibabel",)),
    Format("MGH", (".mgh", ".mgz"), _is_mgh, f"{_HERE}.medical:read_mgh", requires=("nibabel",)),
    Format(
        *("MRC", (".mrc", ".ccp4"), lambda path, start: start[208:212] == b"MAP ", f"{_HERE}.mrc:read_mrc"),
        requires=("mrcfile",),
    ),
    Format("NRRD", (".nrrd", ".nhdr"), begins(b"NRRD0"), f"{_HERE}.medical:read_nrrd", requires=("nrrd",)),
    Format(
        *("TIFF", _TIFF, begins(b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")),
        *(f"{_HERE}.tiff:read_tiff", None, ("tifffile",)),
    ),
    Format("TIFF slices", (), _is_slices, f"{_HERE}.tiff:read_slices", requires=("tifffile",)),
    Format("zarr", ADDRESSES, lambda path, _: is_zarr(path), None, f"{_HERE}.zarr_volumes:zarr_volume", ("zarr",)),
    Format("VTK", (".vti",), _is_vti, None, f"{_HERE}.vti:vti_volume", ("vtkmodules",)),
    Format("DICOM", (".dcm",), _is_dicom, _ITK, requires=("SimpleITK",)),
    Format("MetaImage", (".mha", ".mhd"), _is_metaimage, _ITK, requires=("SimpleITK",)),
    Format(
        *("HDF5", (".h5", ".hdf5"), begins(b"\x89HDF\r\n\x1a\n"), None, f"{_HERE}.hdf_volumes:hdf_volume", ("h5py",))
    ),
)

VOXELS = Adapter(
    name="voxels",
    description="volumes, binary or gray; the folder of a DICOM series or of TIFF slices; zarr and HDF5 of any size",
    suffixes=suffixes_of(FORMATS),
    can_open=partial(is_certainly, FORMATS),
    types=(
        *("nibabel.spatialimages.SpatialImage", "SimpleITK.Image", "monai.data.MetaTensor", "xarray.DataArray"),
        *("zarr.Array", "h5py.Dataset", "dask.array.Array"),
    ),
    extra="topokit[cluster,volumes,vti]",
    suffix_requires=requirements_of(FORMATS),
    opener="topokit.adapters.voxels.adapter:from_voxels",
    addresses=ADDRESSES,
    open_labels="topokit.adapters.voxels.labels:from_labels",
    is_large="topokit.adapters.voxels.larger_than_memory:is_large",
)
