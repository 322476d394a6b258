"""How open3d's geometries are recognised, without importing it."""

from __future__ import annotations

from topokit.plugins.adapter import Adapter


class Open3D(Adapter):
    """Point clouds, meshes and voxel grids of open3d; see `topokit.adapters.open3d.adapter.from_open3d`."""

    name = "open3d"
    description = "point clouds, meshes and voxel grids of open3d, as objects"
    suffixes = ()
    types = (
        "open3d.geometry.PointCloud",
        "open3d.geometry.TriangleMesh",
        "open3d.geometry.VoxelGrid",
        "open3d.t.geometry.PointCloud",
        "open3d.t.geometry.TriangleMesh",
    )
    extra = "topokit[open3d]"
    requires = ("open3d",)
    opener = "topokit.adapters.open3d.adapter:from_open3d"
