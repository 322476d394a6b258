"""Shapes as PLY files and objects of trimesh and open3d, with curvature as colors and attributes; curves as lines."""

from topokit.export.loops import save_loops
from topokit.export.open3d import to_open3d
from topokit.export.ply import save_ply
from topokit.export.trimesh import to_trimesh

__all__ = ["save_loops", "save_ply", "to_open3d", "to_trimesh"]
