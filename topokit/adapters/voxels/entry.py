"""How volumes are recognized; nothing that reads them is imported here."""

from __future__ import annotations

from pathlib import Path

from topokit.inputs.files import head, unpacked_head
from topokit.inputs.numpy_header import numpy_kind
from topokit.plugins.adapter import Adapter

NRRD = b"NRRD0"
TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")


def is_volume(source: Path) -> bool:
    """Whether the content is a volume: NRRD, TIFF, a 3-D NumPy array, or NIfTI, gzipped or not."""
    start = head(source)
    if start.startswith((NRRD, *TIFF)) or numpy_kind(source, start) == "volume":
        return True
    return is_nifti(unpacked_head(source))


def is_nifti(start: bytes) -> bool:
    """Whether an unpacked file that begins with these bytes is NIfTI 1 or 2."""
    return start[344:347] in (b"n+1", b"ni1") or start[4:7] == b"n+2"


VOXELS = Adapter(
    name="voxels",
    description="volumes, binary or gray",
    suffixes=(".nii", ".nii.gz", ".nrrd", ".tif", ".tiff", ".npy", ".npz"),
    can_open=is_volume,
    extra="topokit[volumes]",
    suffix_requires=(
        *((suffix, "nibabel") for suffix in (".nii", ".nii.gz")),
        *((suffix, "tifffile") for suffix in (".tif", ".tiff")),
        (".nrrd", "nrrd"),
    ),
    opener="topokit.adapters.voxels.adapter:from_voxels",
)
