"""Topology of voxel solids and how to change it: simple points, ordered growth, closing, the nearest solid."""
