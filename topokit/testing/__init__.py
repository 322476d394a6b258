"""Shapes with known curvature and topology, and the conformance tests for adapters."""

from topokit.core.residence import as_on_accelerator
from topokit.testing.conformance import AdapterConformance
from topokit.testing.host_visits import HostVisit, HostVisits, count_host_visits
from topokit.testing.meshes import genus_mesh, icosphere, joined, linked_tori_mesh, shell_mesh, torus_mesh
from topokit.testing.surfaces import (
    AnalyticSamples,
    cylinder_samples,
    ellipsoid_samples,
    hemisphere_samples,
    linked_tori_samples,
    plate_samples,
    shell_samples,
    sphere_samples,
    torus_samples,
    union,
)
from topokit.testing.wires import deltoidal_icositetrahedron, edge_tubes, torus_knot, triakis_tetrahedron

__all__ = [
    "AdapterConformance",
    "AnalyticSamples",
    "HostVisit",
    "HostVisits",
    "as_on_accelerator",
    "count_host_visits",
    "cylinder_samples",
    "deltoidal_icositetrahedron",
    "edge_tubes",
    "ellipsoid_samples",
    "genus_mesh",
    "hemisphere_samples",
    "icosphere",
    "joined",
    "linked_tori_mesh",
    "linked_tori_samples",
    "plate_samples",
    "shell_mesh",
    "shell_samples",
    "sphere_samples",
    "torus_knot",
    "torus_mesh",
    "torus_samples",
    "triakis_tetrahedron",
    "union",
]
