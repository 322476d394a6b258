"""How volumes are recognised, without importing what reads them."""

from __future__ import annotations

from pathlib import Path

from topokit.inputs.files import head, numpy_kind, unpacked_head
from topokit.plugins.adapter import Adapter

NRRD = b"NRRD0"
TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")


class Voxels(Adapter):
    """Volumes; see `topokit.from_voxels`."""

    name = "voxels"
    description = "volumes, binary or grey"
    suffixes = (".nii", ".nii.gz", ".nrrd", ".tif", ".tiff", ".npy", ".npz")
    extra = "topokit[volumes]"
    suffix_requires = (
        *((suffix, "nibabel") for suffix in (".nii", ".nii.gz")),
        *((suffix, "tifffile") for suffix in (".tif", ".tiff")),
        (".nrrd", "nrrd"),
    )
    opener = "topokit.adapters.voxels.adapter:from_voxels"

    def can_open(self, source: Path) -> bool:
        start = head(source)
        if start.startswith((NRRD, *TIFF)) or numpy_kind(source, start) == "volume":
            return True
        return is_nifti(unpacked_head(source))


def is_nifti(start: bytes) -> bool:
    """Whether a file that begins so, once unpacked, is NIfTI 1 or 2."""
    return start[344:347] in (b"n+1", b"ni1") or start[4:7] == b"n+2"
