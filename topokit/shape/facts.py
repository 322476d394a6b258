"""Plain facts about a shape, under the names that other mesh libraries use: closedness, Betti numbers, size, parts.

The functions are methods of `Shape`; those without further arguments are properties where trimesh has properties.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from topokit.core.arrays import Floats
from topokit.core.components import Corner
from topokit.core.grid.minkowski import MinkowskiNumbers, cube_counts, minkowski_numbers
from topokit.core.loops import bounds_of
from topokit.core.mesh.topology import MeshTopology, mesh_topology
from topokit.core.surface import TriangleSurface, vector_areas
from topokit.errors import InputError
from topokit.report.report import Betti
from topokit.shape.surface import closed_surface, mesh_arrays

if TYPE_CHECKING:
    import trimesh

    from topokit.shape.shape import Shape

OTHER_WORDS = {
    "points": "samples.points",
    "normals": "samples.normals, or oriented().samples.normals",
    "vertices": "mesh[0]",
    "faces": "mesh[1]",
    "is_watertight": "is_closed",
    "is_manifold": "counted.manifold",
    "euler_number": "euler()",
    "euler_characteristic": "euler()",
    "betti_numbers": "betti()",
    "components": "n_components, or split()",
    "repair": "simplify(below=...) or fill_boundaries()",
    "smooth": "regularized()",
    "export": "save(path), surface().export(path) or save_ply(path)",
}
"""What is asked for under these names in other libraries."""


class BettiNumbers(NamedTuple):
    """Betti numbers of a shape.

    Attributes:
        surface: (c, 2g, c) of the closed surface, for c components of total genus g; None if it is open or unknown.
        solid: (pieces, tunnels, cavities) of the solid inside the surface; None likewise.
    """

    surface: Betti | None
    solid: Betti | None


def is_closed(shape: Shape) -> bool:
    """Whether the surface is closed; `report().closed`. A report of points takes seconds, once."""
    return shape.report().closed


def n_components(shape: Shape) -> int:
    """Number of connected components of the surface; a hollow ball has two. `report().components`."""
    return shape.report().components


def betti(shape: Shape) -> BettiNumbers:
    """Betti numbers of the surface and of the solid inside it, as in the report.

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import genus_mesh
        >>> tk.from_mesh(genus_mesh(3)).betti()
        BettiNumbers(surface=(1, 6, 1), solid=(1, 3, 0))
    """
    report = shape.report()
    return BettiNumbers(report.surface_betti, report.solid_betti)


def bounds(shape: Shape) -> tuple[Corner, Corner]:
    """Lowest and highest corner of the bounding box, in units of length: of what was counted, else of the samples."""
    if shape.counted is not None and len(parts := shape.counted.components):
        return bounds_of(np.concatenate((parts.low, parts.high)))
    return bounds_of(sample_points(shape, "bounds are those"))


def area(shape: Shape) -> float:
    """Surface area: of the triangles of a mesh, else the sum of the samples' Voronoi areas, which noise makes larger.

    The differentiable value is `curvature().area.sum()`.

    Raises:
        InputError: if there is no mesh and the samples are batched.
    """
    if shape.mesh is not None:
        vertices, faces = mesh_arrays(shape.mesh)
        return float(np.linalg.norm(vector_areas(vertices[faces]), axis=1).sum())
    sample_points(shape, "area is that")
    return float(shape.curvature().area.detach().double().sum())


def volume(shape: Shape) -> float:
    """Volume of the solid that the closed surface bounds, without its cavities; `surface().volume`.

    Raises:
        InputError: if there is no closed surface; see `surface`.
    """
    surface = closed_surface(shape)
    a, b, c = ((surface.vertices - surface.vertices[0])[surface.faces[:, corner]] for corner in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def minkowski(shape: Shape) -> MinkowskiNumbers:
    """Volume, surface area, mean breadth and χ of a volume's solid, from counts of its cubes of 2 × 2 × 2 voxels.

    A function has those of its field's grid. Area and mean breadth are Crofton's formulas with 13 directions,
    also where the spacing differs along the axes: within 1 % for balls of 20 voxels across, and 7 to 10 % too small for
    faces along the axes. Not differentiable.

    Returns:
        `MinkowskiNumbers`, in units of length: of one period of a periodic cell, and of a box that was cut from a
        larger body (`edges="cut-out"`) what it contributes to those of the body.

    Raises:
        InputError: if the shape has no voxels in memory (meshes, points, volumes that are counted block by block).

    Reference:
        Legland, Kiêu and Devaux 2007, DOI 10.5566/ias.v26.p83-92.

    Example:
        >>> import numpy as np, topokit as tk
        >>> found = tk.from_voxels(np.ones((4, 5, 6), dtype=bool), spacing=0.5).minkowski()
        >>> found.volume, found.euler
        (15.0, 1.0)
    """
    if shape.counted is not None and shape.counted.minkowski is not None:
        return shape.counted.minkowski
    if shape.field is None:
        raise InputError(
            f"{shape.name} has no voxels in memory; Minkowski numbers are those of volumes and functions. area and "
            "volume are those of other shapes."
        )
    values, level = shape.field.gray_values()
    cubes = cube_counts(np.pad((values > level).cpu().numpy(), 1))
    return minkowski_numbers(cubes, shape.field.connectivity, shape.field.grid.spacing)


def split(shape: Shape) -> tuple[trimesh.Trimesh, ...]:
    """The connected components as meshes, in the order of `report().per_component`: largest area first.

    The components of a mesh that is open are split as they are; other shapes need a closed surface. Each part is a
    `trimesh.Trimesh`; `topokit.from_mesh(part)` is a shape again. Faces that bound a cavity point into it.

    Raises:
        InputError: if the shape is no mesh and has no closed surface; see `surface`.

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import genus_mesh, torus_mesh
        >>> len(tk.from_mesh(torus_mesh()).split())
        1
    """
    from topokit.export.trimesh import as_trimesh

    vertices, topology = _mesh_of(shape)
    parts = (topology.faces[topology.face_labels == number] for number in range(len(topology.components)))
    return tuple(as_trimesh(TriangleSurface(vertices, faces).compact()) for faces in parts)


def sample_points(shape: Shape, what: str) -> Floats:
    """The samples (N, 3), unless they are batched."""
    points = shape.samples.points.detach().cpu().double().numpy()
    if points.ndim != 2:
        raise InputError(f"{what} of one shape; the samples are batched, {points.shape}: make a shape of each item.")
    return points


def _mesh_of(shape: Shape) -> tuple[Floats, MeshTopology]:
    """Vertices and counted faces: of the mesh, else of the closed surface."""
    if shape.mesh is not None:
        vertices, faces = mesh_arrays(shape.mesh)
    else:
        surface = closed_surface(shape)
        vertices, faces = surface.vertices, surface.faces
    return vertices, mesh_topology(vertices, faces)
