"""Gaussian-splat file formats, one per file."""
