"""TIFF stacks through tifffile, with the voxel sizes that ImageJ and OME write."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.voxels.bounds import check_pages, check_tiff
from topokit.core.grid.grid import Spacing
from topokit.errors import MissingDependencyError
from topokit.inputs.reading import reading

_MICROMETERS = {"m": 1e6, "cm": 1e4, "mm": 1e3, "µm": 1.0, "μm": 1.0, "um": 1.0, "nm": 1e-3, "pm": 1e-6, "Å": 1e-4}


class _Alone(io.BufferedReader):
    """A file without a place on the disk: beside one, tifffile looks for more files of NDTiff and Micro-Manager."""

    def fileno(self) -> int:
        """None, so that it is no file for tifffile."""
        raise io.UnsupportedOperation("fileno")


def read_tiff(path: Path) -> tuple[NDArray[Any], Spacing | None]:
    """The first series of a file, in the order of its axes: Z, Y, X for stacks; axes of length 1 are left out."""
    try:
        import tifffile
    except ImportError as error:
        raise MissingDependencyError('Reading .tif needs tifffile: pip install "topokit[volumes]".') from error
    damaged = (
        *(tifffile.TiffFileError, ArithmeticError, AssertionError, LookupError),
        *(RuntimeError, TypeError, AttributeError, SyntaxError),  # the last one of damaged OME-XML
    )
    check_pages(path)
    with (
        reading(path, "tifffile", *damaged),
        _Alone(path.open("rb", buffering=0)) as stream,
        tifffile.TiffFile(stream, _multifile=False) as file,
    ):
        check_tiff(path, file)
        array = file.asarray()
        axes = file.series[0].axes if file.series else ""
        sizes = _voxel_sizes(file)
    if array.ndim > 3 and len(axes) == array.ndim:
        axes = "".join(axis for axis, length in zip(axes, array.shape, strict=True) if length > 1)
        array = np.squeeze(array)
    if sizes is None or axes not in ("ZYX", "QYX", "IYX", "TYX"):  # Q, I: pages that are named by nothing
        return array, None
    return array, (sizes["Z"], sizes["Y"], sizes["X"])


def _voxel_sizes(file: Any) -> dict[str, float] | None:
    """Sizes along X, Y and Z in one unit, if the file tells them."""
    if file.is_ome:
        return _of_ome(file.ome_metadata)
    if not file.is_imagej:
        return None
    tags = file.pages[0].tags
    resolutions = {axis: tags.valueof(f"{axis}Resolution", default=(1, 1)) for axis in "XY"}  # pixels in a unit
    sizes = {axis: pixels[1] / pixels[0] if pixels[0] else 1.0 for axis, pixels in resolutions.items()}
    return {**sizes, "Z": float((file.imagej_metadata or {}).get("spacing", 1.0))}


def _of_ome(text: str) -> dict[str, float] | None:
    from tifffile import xml2dict

    images = xml2dict(text).get("OME", {}).get("Image", {})
    pixels = (images[0] if isinstance(images, list) else images).get("Pixels", {})
    if any(f"PhysicalSize{axis}" not in pixels for axis in "XYZ"):
        return None
    units = {axis: pixels.get(f"PhysicalSize{axis}Unit", "µm") for axis in "XYZ"}
    if not set(units.values()) <= set(_MICROMETERS):
        return None
    scale = {axis: _MICROMETERS[unit] / _MICROMETERS[units["X"]] for axis, unit in units.items()}
    return {axis: float(pixels[f"PhysicalSize{axis}"]) * scale[axis] for axis in "XYZ"}
