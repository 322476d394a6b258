"""Geometries of Open3D."""
