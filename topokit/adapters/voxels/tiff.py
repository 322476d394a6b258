"""TIFF stacks through tifffile, with the voxel sizes that ImageJ and OME write."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.voxels.announced_sizes import check_tiff, page_count
from topokit.adapters.voxels.entry import slice_files
from topokit.core.grid.placement import Placement
from topokit.errors import ReadError, requiring
from topokit.inputs.reading import reading

_MICROMETERS = {"m": 1e6, "cm": 1e4, "mm": 1e3, "µm": 1.0, "μm": 1.0, "um": 1.0, "nm": 1e-3, "pm": 1e-6, "Å": 1e-4}


class _Alone(io.BufferedReader):
    """A file without a place on the disk: beside one, tifffile looks for more files of NDTiff and Micro-Manager."""

    def fileno(self) -> int:
        """None, so that it is no file for tifffile."""
        raise io.UnsupportedOperation("fileno")


def read_tiff(path: Path) -> tuple[NDArray[Any], Placement | None]:
    """The first series of a file, in the order of its axes: Z, Y, X for stacks; axes of length 1 are left out."""
    with requiring('Reading .tif needs tifffile: pip install "topokit[volumes]".'):
        import tifffile
    damaged = (
        *(tifffile.TiffFileError, ArithmeticError, AssertionError, LookupError),
        *(RuntimeError, TypeError, AttributeError, SyntaxError),  # the last one of damaged OME-XML
    )
    page_count(path)
    with (
        reading(path, "tifffile", *damaged),
        _Alone(path.open("rb", buffering=0)) as stream,
        tifffile.TiffFile(stream, _multifile=False) as file,
    ):
        check_tiff(path, file)
        array = file.asarray()
        axes = file.series[0].axes if file.series else ""
        sizes, unit = _voxel_sizes(file)
    if array.ndim > 3 and len(axes) == array.ndim:
        axes = "".join(axis for axis, length in zip(axes, array.shape, strict=True) if length > 1)
        array = np.squeeze(array)
    if not sizes or axes not in ("ZYX", "QYX", "IYX", "TYX"):  # Q, I: pages that are named by nothing
        return array, None
    return array, Placement((sizes["Z"], sizes["Y"], sizes["X"]), unit=unit)


def read_slices(folder: Path) -> tuple[NDArray[Any], Placement | None]:
    """A folder with a file for each slice, stacked along the first axis in the order of the numbers in their names."""
    paths = sorted(slice_files(folder), key=lambda path: ([int(n) for n in re.findall(r"\d+", path.name)], path.name))
    slices = [read_tiff(path)[0] for path in paths]
    for path, one in zip(paths, slices, strict=True):
        if one.ndim != 2 or (one.shape, one.dtype) != (slices[0].shape, slices[0].dtype):
            raise ReadError(
                f"{folder} is no stack of slices: {path.name} has shape {one.shape} and type {one.dtype}, but "
                f"{paths[0].name} has {slices[0].shape} and {slices[0].dtype}."
            )
    return np.stack(slices), None


def _voxel_sizes(file: Any) -> tuple[dict[str, float], str]:
    """Sizes along X, Y and Z in one unit, if the file tells them, and the unit."""
    if file.is_ome:
        return _of_ome(file.ome_metadata)
    if not file.is_imagej:
        return {}, ""
    tags = file.pages[0].tags
    resolutions = {axis: tags.valueof(f"{axis}Resolution", default=(1, 1)) for axis in "XY"}  # pixels in a unit
    sizes = {axis: pixels[1] / pixels[0] if pixels[0] else 1.0 for axis, pixels in resolutions.items()}
    told = file.imagej_metadata or {}
    unit = {"micron": "µm", "um": "µm", r"\u00B5m": "µm"}.get(told.get("unit", ""), told.get("unit", ""))
    return {**sizes, "Z": float(told.get("spacing", 1.0))}, unit


def _of_ome(text: str) -> tuple[dict[str, float], str]:
    from tifffile import xml2dict

    images = xml2dict(text).get("OME", {}).get("Image", {})
    pixels = (images[0] if isinstance(images, list) else images).get("Pixels", {})
    if any(f"PhysicalSize{axis}" not in pixels for axis in "XYZ"):
        return {}, ""
    units = {axis: pixels.get(f"PhysicalSize{axis}Unit", "µm") for axis in "XYZ"}
    if not set(units.values()) <= set(_MICROMETERS):
        return {}, ""
    scale = {axis: _MICROMETERS[unit] / _MICROMETERS[units["X"]] for axis, unit in units.items()}
    return {axis: float(pixels[f"PhysicalSize{axis}"]) * scale[axis] for axis in "XYZ"}, units["X"]
