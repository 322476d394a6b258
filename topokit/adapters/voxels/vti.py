"""Images of VTK (`.vti`) through VTK's own reader, box by box."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.voxels.chosen_part import Entry, chosen_array, not_a_volume
from topokit.adapters.voxels.stored_volumes import StoredVolume, Values
from topokit.adapters.voxels.vti_guards import checked_cells, errors_raised
from topokit.core.blocks.division import Box, Triple
from topokit.core.grid.placement import Placement
from topokit.errors import requiring
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import FREE_OF_MASKS, require_expansion

_AXES = ("x", "y", "z", "c")  # of an array with several components


class _Image(NamedTuple):
    """What a file says before its values are read.

    Attributes:
        first: index of the first point along each axis, which need not be 0.
        n_points: along each axis.
        affine: 4 × 4, takes the index of a point, counted from `first`, to its position.
        arrays: type and number of components, by "PointData/…" or "CellData/…".
    """

    first: Triple
    n_points: Triple
    affine: NDArray[np.float64]
    arrays: dict[str, tuple[np.dtype[Any], int]]

    def shape(self, name: str) -> tuple[int, ...]:
        """Of an array: (X, Y, Z), or (X, Y, Z, components) if there are several. Flat images have a layer of cells."""
        has_cells, n_components = name.startswith("CellData/"), self.arrays[name][1]
        sizes = tuple(max(1, n - has_cells) for n in self.n_points)
        return sizes if n_components == 1 else (*sizes, n_components)


def vti_volume(path: Path, entry: Entry) -> StoredVolume:
    """The only volume of a file, or the one that the data set names.

    Raises:
        ReadError: if the file is malformed, or has no such array.
        MissingDependencyError: without VTK.
        InputError: if there are several volumes and no data set, or several components and no channel.
    """
    with requiring('Reading .vti needs VTK: pip install "topokit[vti]".'):
        import vtkmodules.vtkIOXML  # noqa: F401
    with reading(path, "VTK"):
        image = _image_of(path)
    name = chosen_array(path, {one: image.shape(one) for one in image.arrays}, entry)
    kind, n_components = image.arrays[name]
    if n_components > 1 and entry.channel is None:
        raise not_a_volume(image.shape(name), _AXES)
    require_expansion(path, math.prod(image.shape(name)) * kind.itemsize, path.stat().st_size, FREE_OF_MASKS)
    return VtkVolume(path, name, image, entry)


class VtkVolume(StoredVolume):
    """An array of a file; other processes open the file for themselves."""

    def __init__(self, path: Path, name: str, image: _Image, entry: Entry) -> None:
        """Args: the file, the array in it, what the file says, and which part of the array is the volume."""
        shape, (kind, _) = image.shape(name), image.arrays[name]
        chunks = (*shape[:2], *(1 for _ in shape[2:]))  # layers along z: rows may be compressed together
        super().__init__(path.name, shape, kind, chunks, entry, _AXES[: len(shape)])
        self._path, self._array, self._image, self._shape = path.absolute(), name, image, shape
        affine = image.affine.copy()
        if name.startswith("CellData/"):
            affine[:3, 3] += affine[:3, :3] @ [0.5 * (n > 1) for n in image.n_points]
        self.placement = Placement.of_affine(affine)

    def read(self, box: Box) -> Values:
        """See `StoredVolume`."""
        field, _, name = self._array.partition("/")
        where = self._slices(box)
        sides = [(one, one + 1) if isinstance(one, int) else (one.start, one.stop) for one in where[:3]]
        is_flat = [field == "PointData" or n == 1 for n in self._image.n_points]
        extent = [
            first + end
            for first, flat, (start, stop) in zip(self._image.first, is_flat, sides, strict=True)
            for end in (start, stop - flat)  # always of points
        ]
        sizes = (*(stop - start for start, stop in sides), *self._shape[3:])
        with reading(self._path, "VTK"), errors_raised():
            values = _values(self._path, field, name, extent, math.prod(sizes)).reshape(sizes, order="F")
        return values[(*(0 if isinstance(one, int) else slice(None) for one in where[:3]), *where[3:])]


def _values(path: Path, field: str, name: str, extent: list[int], n_values: int) -> Values:
    """The values of an array of points or cells within an extent of points."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader = _reader(path)
    choices = {"PointData": reader.GetPointDataArraySelection(), "CellData": reader.GetCellDataArraySelection()}
    for choice in choices.values():
        choice.DisableAllArrays()
    choices[field].EnableArray(name)
    reader.UpdateExtent(extent)
    image = reader.GetOutput()
    found = (image.GetPointData() if field == "PointData" else image.GetCellData()).GetArray(name)
    if found is None or found.GetNumberOfValues() != n_values:
        raise ValueError(f"the values of {name!r} are missing")
    return vtk_to_numpy(found)


def _image_of(path: Path) -> _Image:
    """What a file says before its values are read."""
    from vtkmodules.vtkCommonDataModel import vtkDataObject
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    with errors_raised():
        reader = _reader(path)
        reader.UpdateInformation()
        info = reader.GetOutputInformation(0)
        extent = info.Get(vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT())
        spacing, origin, directions = (
            info.Get(key()) for key in (vtkDataObject.SPACING, vtkDataObject.ORIGIN, vtkDataObject.DIRECTION)
        )
        points, cells = (info.Get(key()) for key in (vtkDataObject.POINT_DATA_VECTOR, vtkDataObject.CELL_DATA_VECTOR))
        arrays = _arrays("PointData", points) | _arrays("CellData", cells)
    if extent is None or min(np.diff(np.reshape(extent, (3, 2)))) < 0:
        raise ValueError("it has no points")
    n_cells = np.maximum(1, np.diff(np.reshape(extent, (3, 2)))).tolist()
    if checked_cells(path) != math.prod(n for [n] in n_cells):
        raise ValueError("its pieces are not the whole image")
    low, high = extent[::2], extent[1::2]
    affine = np.eye(4)
    affine[:3, :3] = np.reshape(directions, (3, 3)) * spacing
    affine[:3, 3] = origin + affine[:3, :3] @ low
    x, y, z = (b - a + 1 for a, b in zip(low, high, strict=True))
    return _Image(low, (x, y, z), affine, arrays)


def _arrays(field: str, told: Any) -> dict[str, tuple[np.dtype[Any], int]]:
    """Type and number of components of the arrays of numbers in the points or cells."""
    from vtkmodules.util.numpy_support import get_vtk_to_numpy_typemap
    from vtkmodules.vtkCommonDataModel import vtkDataObject

    kinds, found = get_vtk_to_numpy_typemap(), {}
    for number in range(told.GetNumberOfInformationObjects() if told else 0):
        one = told.GetInformationObject(number)
        kind = kinds.get(one.Get(vtkDataObject.FIELD_ARRAY_TYPE()))
        if kind is not None:
            n_components = one.Get(vtkDataObject.FIELD_NUMBER_OF_COMPONENTS())
            found[f"{field}/{one.Get(vtkDataObject.FIELD_NAME())}"] = np.dtype(kind), n_components
    return found


def _reader(path: Path) -> Any:
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    return reader
