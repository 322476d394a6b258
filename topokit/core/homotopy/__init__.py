"""Topology of voxel solids and how to change it: simple points, homotopy warping, the nearest solid."""
