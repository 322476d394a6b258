"""open3d's point clouds, meshes and voxel grids, in and back out; the only file that imports open3d."""

from __future__ import annotations

import ctypes
import re
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from topokit.drawing import Drawing, Quantity, draw
from topokit.errors import InputError, MissingDependencyError
from topokit.objects import points_of, triangles_of
from topokit.registry import load

if TYPE_CHECKING:
    from topokit.shape import Shape

_INSTALL = 'pip install "topokit[open3d]"'
_DEBIAN_PACKAGES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libgomp.so.1": "libgomp1",
    "libEGL.so.1": "libegl1",
}
_MOST_CELLS = 1 << 32  # of the dense grid around the voxels, a byte each


def from_open3d(geometry: Any, **options: Any) -> Shape:
    """A geometry of open3d as the shape that its arrays would be.

    A cloud is opened as by `topokit.from_points`, with its normals if it has any, a mesh as by `topokit.from_mesh`,
    and a voxel grid as by `topokit.from_voxels`: its voxels are the solid, 26-connected unless `connectivity` says
    otherwise, and samples lie where the grid lies. (A grid that open3d made of a cloud or a mesh is a shell, whose
    surface has an outer and an inner wall.) open3d knows no gradients, so neither does the shape.

    Args:
        geometry: an `open3d.geometry` `PointCloud`, `TriangleMesh` or `VoxelGrid`, or an `open3d.t.geometry`
            `PointCloud` or `TriangleMesh`. Tensors keep device and floating type and share their memory with the shape:
            changing them in place changes it.
        options: of the function that opens it (`n_neighbors`, `n_samples`, `connectivity`, ...).

    Raises:
        InputError: for another geometry, an empty one, or a rotated voxel grid, and whatever that function refuses.
    """
    if hasattr(geometry, "get_voxels"):
        volume, origin = _dense(geometry)
        return load(volume, adapter="voxels", spacing=float(geometry.voxel_size), origin=origin, **options)
    if triangles_of(geometry) is not None:
        return load(geometry, adapter="mesh", **options)
    if points_of(geometry) is not None:
        return load(geometry, adapter="points", **options)
    raise InputError(
        f"from_open3d got {type(geometry).__name__}; expected a PointCloud or a TriangleMesh with positions, or a "
        "VoxelGrid."
    )


def to_open3d(shape: Shape, color_by: Quantity = "gaussian", *, tensor: bool = False) -> Any:
    """A shape as a geometry of open3d, with curvature as colours.

    A mesh stays a mesh, each vertex with the curvature of the samples around it; anything else becomes the cloud of its
    samples, with normals, which point outward where the shape is oriented (see `Shape.oriented`). Blue is negative,
    white zero, red positive, see `topokit.drawing.draw`. The geometry has memory of its own, so that moving it
    leaves the shape alone; gradients end here.

    Args:
        shape: any shape that is not batched.
        color_by: "gaussian", "mean" or "total".
        tensor: whether to use the tensor API, whose geometries also carry gaussian, mean, total, k_min, k_max and area
            as attributes (N, 1) of points or vertices, in the type of the samples and on their device (on the
            CPU if open3d was built without CUDA).

    Returns:
        `open3d.geometry.TriangleMesh` or `PointCloud`, with `tensor` those of `open3d.t.geometry`.

    Raises:
        InputError: if `color_by` is not one of the three, or the samples are batched.
        MissingDependencyError: if open3d is not installed, or lacks system libraries, which are named.
    """
    o3d = _open3d()
    drawing = draw(shape, color_by)
    points = shape.samples.points
    dtype = np.float64 if points.element_size() == 8 else np.float32
    on_gpu = points.is_cuda and o3d.core.cuda.is_available()
    device = o3d.core.Device(f"CUDA:{points.get_device()}" if on_gpu else "CPU:0")
    geometry = _geometry(o3d, drawing, dtype, device)
    return geometry if tensor else geometry.to_legacy()


def _geometry(o3d: Any, drawing: Drawing, dtype: type[np.floating[Any]], device: Any) -> Any:
    """The drawing in open3d's tensor API."""

    def tensor(values: NDArray[Any], dtype: type[np.generic]) -> Any:
        return o3d.core.Tensor(np.ascontiguousarray(values, dtype=dtype), device=device)

    is_mesh = drawing.faces is not None
    geometry = o3d.t.geometry.TriangleMesh(device) if is_mesh else o3d.t.geometry.PointCloud(device)
    attributes = geometry.vertex if is_mesh else geometry.point
    attributes["positions"] = tensor(drawing.positions, dtype)
    attributes["colors"] = tensor(drawing.colors / 255, np.float32)
    for name, values in drawing.fields.items():
        attributes[name] = tensor(values[:, None], dtype)
    if drawing.faces is None:
        attributes["normals"] = tensor(drawing.normals, dtype)
    else:
        geometry.triangle["indices"] = tensor(drawing.faces, np.int64)
        geometry.compute_vertex_normals()  # from the faces, which are better than the samples around a sharp corner
    return geometry


def _dense(grid: Any) -> tuple[NDArray[np.bool_], tuple[float, float, float]]:
    """The voxels as a volume with a layer of background around them, and the centre of its first cell."""
    index = np.array([voxel.grid_index for voxel in grid.get_voxels()], dtype=np.int64).reshape(-1, 3)
    if len(index) == 0:
        raise InputError("the VoxelGrid has no voxels.")
    if not np.allclose(getattr(grid, "rotation", np.eye(3)), np.eye(3), rtol=0, atol=1e-9):
        raise InputError(
            "the VoxelGrid is rotated, and topokit's volumes lie along the axes: undo that with "
            "grid.rotate(grid.rotation.T, center=(0, 0, 0)), or rotate before the voxels are made."
        )
    first = index.min(axis=0) - 1
    shape = index.max(axis=0) - first + 2
    if shape.prod() > _MOST_CELLS:
        raise InputError(
            f"the VoxelGrid spans {' × '.join(map(str, shape))} cells, too many for a volume: use larger voxels, or "
            "remove those that lie far away."
        )
    volume = np.zeros(shape, dtype=bool)
    volume[tuple((index - first).T)] = True
    x, y, z = (np.asarray(grid.origin) + (first + 0.5) * grid.voxel_size).tolist()
    return volume, (x, y, z)


def _open3d() -> Any:
    try:
        import open3d
    except ModuleNotFoundError as error:
        lack = "open3d" if error.name == "open3d" else f"a package that open3d needs ({error.name})"
        raise MissingDependencyError(f"to_open3d needs {lack}, which is not installed: {_INSTALL}.") from error
    except (ImportError, OSError) as error:
        raise MissingDependencyError(_what_is_missing(str(error))) from error
    return open3d


def _what_is_missing(said: str) -> str:
    """Why open3d could not be loaded: the linker names the first library it lacks, the others are looked for here."""
    libraries = re.findall(r"^(\S+): cannot open shared object file", said)
    if sys.platform == "linux":
        libraries += [name for name in _DEBIAN_PACKAGES if name not in libraries and not _is_there(name)]
    if not libraries:
        return f"open3d is installed but could not be loaded ({said}). Install it again: {_INSTALL}."
    known = [_DEBIAN_PACKAGES[name] for name in libraries if name in _DEBIAN_PACKAGES]
    others = [name for name in libraries if name not in _DEBIAN_PACKAGES]
    ways = [f"sudo apt-get install {' '.join(known)}"] if known else []
    ways += [f"apt-file search {name} names the package of {name}" for name in others]
    return (
        f"open3d is installed, but system libraries that it loads are missing: {', '.join(libraries)}. "
        f"On Debian and Ubuntu: {'; '.join(ways)}."
    )


def _is_there(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
