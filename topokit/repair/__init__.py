"""Meshes with simpler topology: small handles removed, boundaries filled."""
