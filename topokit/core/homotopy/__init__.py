"""Changing the topology of voxel solids: simple points, deformation, the nearest solid."""
