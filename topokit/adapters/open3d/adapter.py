"""Open3D point clouds, meshes and voxel grids as shapes.

Arrays of a geometry are opened by the built-in adapters, asked for by name through the registry: adapters do not
import each other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from topokit.errors import InputError
from topokit.inputs.objects import points_of, triangles_of
from topokit.plugins.registry import load

if TYPE_CHECKING:
    from topokit.shape import Shape

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


def _dense(grid: Any) -> tuple[NDArray[np.bool_], tuple[float, float, float]]:
    """The voxels as a volume with a layer of background around them, and the center of its first cell."""
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
