"""Shapes with known curvature and topology, for tests, examples and whoever writes an adapter."""

from topokit.testing.meshes import genus_mesh, icosphere, torus_mesh
from topokit.testing.surfaces import (
    AnalyticSamples,
    ellipsoid_samples,
    sphere_samples,
    torus_samples,
)

__all__ = [
    "AnalyticSamples",
    "ellipsoid_samples",
    "genus_mesh",
    "icosphere",
    "sphere_samples",
    "torus_mesh",
    "torus_samples",
]
