"""How open3d's geometries are recognized, without importing it."""

from __future__ import annotations

from topokit.plugins.adapter import Adapter

OPEN3D = Adapter(
    name="open3d",
    description="point clouds, meshes and voxel grids of open3d, as objects",
    suffixes=(),
    types=(
        *(f"open3d.geometry.{kind}" for kind in ("PointCloud", "TriangleMesh", "VoxelGrid")),
        *(f"open3d.t.geometry.{kind}" for kind in ("PointCloud", "TriangleMesh")),
    ),
    extra="topokit[open3d]",
    requires=("open3d",),
    opener="topokit.adapters.open3d.adapter:from_open3d",
)
