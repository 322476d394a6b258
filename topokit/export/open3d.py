"""Shapes as Open3D geometries; the only file that imports open3d."""

from __future__ import annotations

import ctypes
import re
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from topokit.errors import MissingDependencyError
from topokit.export.colors import ColoredSurface, Quantity, colored_surface

if TYPE_CHECKING:
    from topokit.shape import Shape

_INSTALL = 'pip install "topokit[open3d]"'
_DEBIAN_PACKAGES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libgomp.so.1": "libgomp1",
    "libEGL.so.1": "libegl1",
}


def to_open3d(shape: Shape, color_by: Quantity = "gaussian", *, tensor: bool = False) -> Any:
    """A shape as a geometry of open3d, with curvature as colors.

    A mesh stays a mesh, each vertex with the curvature of the samples around it; any other shape becomes the cloud of
    its samples, with normals, which point outward where the shape is oriented (see `Shape.oriented`). Blue is negative,
    white zero, red positive, see `topokit.export.colors`. The geometry is a copy; gradients end here.

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
    surface = colored_surface(shape, color_by)
    points = shape.samples.points
    dtype = np.float64 if points.element_size() == 8 else np.float32
    on_gpu = points.is_cuda and o3d.core.cuda.is_available()
    device = o3d.core.Device(f"CUDA:{points.get_device()}" if on_gpu else "CPU:0")
    geometry = _geometry(o3d, surface, dtype, device)
    return geometry if tensor else geometry.to_legacy()


def _geometry(o3d: Any, surface: ColoredSurface, dtype: type[np.floating[Any]], device: Any) -> Any:
    """The surface in open3d's tensor API."""

    def tensor(values: NDArray[Any], dtype: type[np.generic]) -> Any:
        return o3d.core.Tensor(np.ascontiguousarray(values, dtype=dtype), device=device)

    is_mesh = surface.faces is not None
    geometry = o3d.t.geometry.TriangleMesh(device) if is_mesh else o3d.t.geometry.PointCloud(device)
    attributes = geometry.vertex if is_mesh else geometry.point
    attributes["positions"] = tensor(surface.positions, dtype)
    attributes["colors"] = tensor(surface.colors / 255, np.float32)
    for name, values in surface.fields.items():
        attributes[name] = tensor(values[:, None], dtype)
    if surface.faces is None:
        attributes["normals"] = tensor(surface.normals, dtype)
    else:
        geometry.triangle["indices"] = tensor(surface.faces, np.int64)
        geometry.compute_vertex_normals()  # from the faces, which are better than the samples around a sharp corner
    return geometry


def _open3d() -> Any:
    try:
        import open3d
    except ModuleNotFoundError as error:
        missing = "open3d" if error.name == "open3d" else f"a package that open3d needs ({error.name})"
        raise MissingDependencyError(f"to_open3d needs {missing}, which is not installed: {_INSTALL}.") from error
    except (ImportError, OSError) as error:
        raise MissingDependencyError(_what_is_missing(str(error))) from error
    return open3d


def _what_is_missing(message: str) -> str:
    """Why open3d could not be loaded. The linker names only the first missing library; the others are tried here."""
    libraries = re.findall(r"^(\S+): cannot open shared object file", message)
    if sys.platform == "linux":
        libraries += [name for name in _DEBIAN_PACKAGES if name not in libraries and not _can_be_loaded(name)]
    if not libraries:
        return f"open3d is installed but could not be loaded ({message}). Install it again: {_INSTALL}."
    known = [_DEBIAN_PACKAGES[name] for name in libraries if name in _DEBIAN_PACKAGES]
    others = [name for name in libraries if name not in _DEBIAN_PACKAGES]
    ways = [f"sudo apt-get install {' '.join(known)}"] if known else []
    ways += [f"apt-file search {name} names the package of {name}" for name in others]
    return (
        f"open3d is installed, but system libraries that it loads are missing: {', '.join(libraries)}. "
        f"On Debian and Ubuntu: {'; '.join(ways)}."
    )


def _can_be_loaded(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
