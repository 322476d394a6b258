"""Readers of mesh files, one per format that needs more than trimesh."""
