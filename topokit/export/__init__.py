"""Shapes as PLY files and as objects of trimesh and open3d, with curvature as colors and attributes."""

from topokit.export.open3d import to_open3d
from topokit.export.ply import save_ply
from topokit.export.trimesh import to_trimesh

__all__ = ["save_ply", "to_open3d", "to_trimesh"]
