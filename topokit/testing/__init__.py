"""Shapes with known curvature and topology, and what adapters are tested by; for whoever writes one."""

from topokit.testing.conformance import AdapterConformance
from topokit.testing.meshes import genus_mesh, icosphere, torus_mesh
from topokit.testing.surfaces import (
    AnalyticSamples,
    ellipsoid_samples,
    sphere_samples,
    torus_samples,
)

__all__ = [
    "AdapterConformance",
    "AnalyticSamples",
    "ellipsoid_samples",
    "genus_mesh",
    "icosphere",
    "sphere_samples",
    "torus_mesh",
    "torus_samples",
]
