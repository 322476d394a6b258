"""Meshes: exact topology by counting, and samples for everything else."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.adapters.mesh.files import read_mesh
from topokit.core.local.curvature import DEFAULT_NEIGHBORS
from topokit.core.mesh.sampling import sample_triangles
from topokit.core.mesh.topology import MeshTopology, connected_labels, mesh_topology
from topokit.errors import InputError
from topokit.inputs.arrays import as_floating, as_tensor
from topokit.inputs.files import existing_file
from topokit.inputs.objects import triangles_of
from topokit.report.mesh import mesh_answer
from topokit.shape import Shape

Vertices = Tensor | ArrayLike
_NEARLY_EQUAL = 1e-8  # share of the bounding box's diagonal within which vertices may be one rounded twice


def from_mesh(
    source: str | os.PathLike[str] | tuple[Vertices, Vertices] | Any,
    *,
    n_samples: int = 10_000,
    n_neighbors: int = DEFAULT_NEIGHBORS,
    generator: torch.Generator | None = None,
) -> Shape:
    """A triangle mesh as a shape whose report is exact.

    `report()` counts V − E + F; `euler()` and `curvature()` come from area-weighted samples and are differentiable
    in the vertices if these are a tensor. Equal vertices are merged only when the mesh is open and merging closes it,
    or mends its boundary without new faults; what was done is said in the report. Faces are turned to agree, and
    closed parts outward, before normals are taken.

    Args:
        source: a path (.obj .off .ply .stl .glb .gltf .3mf); a `trimesh.Trimesh`, a `trimesh.Scene` (flattened with its
            transformations), a mesh of open3d (either API) or anything else with `vertices` and `faces`; or a pair
            (vertices (V, 3), faces (F, 3)) of tensors or arrays. Of these, tensors and whatever offers `__dlpack__`
            keep device and floating type (half precision is widened to float32); other arrays become float64.
        n_samples: number of samples for the differentiable core.
        n_neighbors: k of the local half.
        generator: source of randomness (CPU); seed 0 if None.

    Raises:
        ReadError: if the file is missing or malformed.
        InputError: on wrong shapes, faces out of range, vertices that are not finite, or a mesh without area.

    Example:
        >>> import topokit as tk
        >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
        >>> tk.from_mesh((vertices, faces)).report().euler
        2
    """
    name, vertices, faces = _open(source)
    if n_samples <= n_neighbors:
        raise InputError(f"n_samples is {n_samples}; it must be larger than n_neighbors, which is {n_neighbors}.")
    started = time.perf_counter()
    coordinates = vertices.detach().cpu().double().numpy()
    counted = _count(coordinates, _checked(faces, coordinates))
    answer = mesh_answer(counted.topology, time.perf_counter() - started, exact_vertices=counted.beyond_doubt)
    used = torch.from_numpy(counted.topology.faces).to(vertices.device)
    samples, _ = sample_triangles(vertices, used, n_samples, generator)
    return Shape(samples, answer, mesh=(vertices, used), name=name, notes=counted.notes, n_neighbors=n_neighbors)


@dataclass(frozen=True)
class _Counted:
    """A mesh's topology, how it was read, and whether that reading is beyond doubt."""

    topology: MeshTopology
    notes: tuple[str, ...] = ()
    beyond_doubt: bool = True


def _open(source: object) -> tuple[str, Tensor, NDArray[np.int64]]:
    if isinstance(source, str | os.PathLike):
        path = existing_file(source)
        vertices, faces = read_mesh(path)
        return path.name, torch.from_numpy(vertices), faces
    if isinstance(source, tuple | list) and len(source) == 2:
        return "mesh", _vertices(source[0]), _faces(source[1])
    found = triangles_of(source)
    if found is None:
        raise InputError(
            f"from_mesh got {type(source).__name__}; expected a path, a pair (vertices, faces), a mesh of trimesh or "
            "open3d, or anything else with vertices and faces. For points use topokit.from_points."
        )
    return "mesh", _vertices(found[0]), _faces(found[1])


def _vertices(values: object) -> Tensor:
    vertices = as_floating(values, "vertices", "(V, 3)")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise InputError(f"vertices must have shape (V, 3), got {tuple(vertices.shape)}.")
    if not vertices.is_floating_point():
        raise InputError(f"vertices must be floating point, got {vertices.dtype}: call .double() or .float() on them.")
    return vertices


def _faces(values: object) -> NDArray[np.int64]:
    array = as_tensor(values, "faces", "(F, 3)").detach().cpu().numpy()
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"faces must have shape (F, 3), got {array.shape}: cut polygons into triangles first.")
    if not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"faces must be integers, got {array.dtype}.")
    return array.astype(np.int64)


def _checked(faces: NDArray[np.int64], vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    if len(faces) == 0:
        raise InputError("the mesh has no faces; for points alone use topokit.from_points.")
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(vertices):
        wrong = low if low < 0 else high
        raise InputError(
            f"face index {wrong} is out of range: there are {len(vertices)} vertices, 0 … {len(vertices) - 1}."
        )
    broken = ~np.isfinite(vertices[faces]).all(axis=(1, 2))
    if broken.any():
        raise InputError(f"{int(broken.sum())} faces use vertices that are NaN or infinite; remove them first.")
    return faces


def _count(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> _Counted:
    """Count the mesh as it stands; where it is open, try whether equal vertices are one vertex written twice."""
    notes = _leftovers(vertices, faces)
    faces = faces[_is_proper(faces)]
    if len(faces) == 0:
        raise InputError("every face of the mesh names a vertex twice: nothing is left to count.")
    shares_vertices = len(np.unique(faces)) < faces.size
    as_given = mesh_topology(vertices, faces)
    if as_given.is_closed:
        return _Counted(as_given, notes)
    merged, n_merged = _count_merged(vertices, faces, 0.0) or (as_given, 0)
    if merged.is_closed or not shares_vertices or _is_mended(as_given, merged):
        effect = "which closes the mesh" if merged.is_closed else "which leaves it open"
        note = f"{n_merged} vertices that equal another were merged, {effect}."
        best = _Counted(merged, (*notes, note) if n_merged else notes)
    else:
        best = _Counted(as_given, notes)
    if best.topology.is_closed:
        return best
    nearly, n_nearly = _count_merged(vertices, faces, _NEARLY_EQUAL) or (merged, 0)
    if not nearly.is_closed:
        return best
    note = (
        f"{n_nearly} vertices within {_NEARLY_EQUAL:g} of the diagonal of another were merged, which closes the mesh."
    )
    return _Counted(nearly, (*notes, note), beyond_doubt=False)


def _count_merged(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], tolerance: float
) -> tuple[MeshTopology, int] | None:
    """The mesh with equal vertices merged and how many were; None if there are none or no face would be left."""
    merged, n_merged = _merge(vertices, faces, tolerance)
    kept = merged[_is_proper(merged)]
    return (mesh_topology(vertices, kept), n_merged) if n_merged and len(kept) else None


def _is_mended(before: MeshTopology, after: MeshTopology) -> bool:
    faults = (before.nonmanifold_edges + before.pinched_vertices, after.nonmanifold_edges + after.pinched_vertices)
    return after.boundary_edges < before.boundary_edges and faults[1] <= faults[0]


def _leftovers(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> tuple[str, ...]:
    n_unused = len(vertices) - len(np.unique(faces))
    n_degenerate = int((~_is_proper(faces)).sum())
    notes = []
    if n_unused:
        notes.append(f"{n_unused} vertices belong to no face and are not counted.")
    if n_degenerate:
        notes.append(f"{n_degenerate} faces name a vertex twice and are not counted.")
    return tuple(notes)


def _is_proper(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Faces that name three different vertices."""
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)


def _merge(vertices: NDArray[np.float64], faces: NDArray[np.int64], tolerance: float) -> tuple[NDArray[np.int64], int]:
    """Faces with equal vertices (within `tolerance` of the diagonal) named by one index; how many were merged."""
    used = np.unique(faces)
    points = vertices[used]
    if tolerance == 0:
        points = points + 0.0  # -0.0 equals 0.0
        _, first, group = np.unique(points, axis=0, return_index=True, return_inverse=True)
        representative = used[first[group.ravel()]]
    else:
        radius = tolerance * float(np.linalg.norm(np.ptp(points, axis=0)))
        pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
        groups = connected_labels(len(points), pairs[:, 0], pairs[:, 1])
        _, first, group = np.unique(groups, return_index=True, return_inverse=True)
        representative = used[first[group.ravel()]]
    renamed = np.arange(len(vertices))
    renamed[used] = representative
    return renamed[faces], int((representative != used).sum())
