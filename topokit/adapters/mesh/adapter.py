"""Meshes: exact topology by counting, and samples for everything else."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from topokit.adapters.mesh.counting import count_mesh
from topokit.adapters.mesh.files import read_mesh
from topokit.adapters.mesh.polygons import triangles
from topokit.core.cloud.sampling.downsampling import fewer_samples
from topokit.core.draws import check_sample_count, deferred_seed
from topokit.core.local.neighborhood_size import given_or_default
from topokit.core.mesh.defects import mesh_defects
from topokit.core.mesh.sampling import sample_triangles
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.inputs.arrays import as_floating
from topokit.inputs.calls import options_by_name
from topokit.inputs.files import existing_file
from topokit.inputs.objects import triangles_of
from topokit.inputs.remote import takes_addresses
from topokit.inputs.unpacking import unpacked
from topokit.report.mesh import mesh_answer
from topokit.shape import Shape

Sampling = Literal["area", "feature-size", "curvature", "even"]
Vertices = Tensor | ArrayLike
Faces = Tensor | ArrayLike | Sequence[Sequence[int]]

_DRAWN_PER_SAMPLE = 10  # random points per sample that a criterion chooses from


@options_by_name("n_samples")
@takes_addresses()
def from_mesh(
    source: str | os.PathLike[str] | tuple[Vertices, Faces] | Vertices | Any,
    faces: Faces | None = None,
    *,
    n_samples: int = 10_000,
    n_neighbors: int | None = None,
    sampling: Sampling = "area",
    generator: torch.Generator | None = None,
) -> Shape:
    """A triangle mesh as a shape whose report is exact.

    V − E + F is counted when the shape is made; the samples for `gauss_bonnet()` and `curvature()` are drawn in
    proportion to area when they are first needed, and are differentiable in the vertices if these are a tensor. Equal
    vertices are merged only when the mesh is open and merging closes it, or mends its boundary without new faults; the
    report says what was done. Faces are turned to agree, and closed parts outward, before normals are taken.

    Args:
        source: a path (.obj .off .ply .stl .glb .gltf .3mf); a `trimesh.Trimesh`, a `trimesh.Scene` (flattened with its
            transformations), a mesh of open3d (either API) or anything else with `vertices` and `faces`; a pair
            (vertices, faces); or vertices (V, 3), with `faces` given apart. Tensors and whatever offers `__dlpack__`
            keep device and floating type (half precision is widened to float32); other arrays become float64.
        faces: vertex indices (F, 3), (F, n) with −1 after the last corner of smaller polygons, or lists of different
            lengths. Polygons are cut into fans.
        n_samples: number of samples for curvature and its estimate.
        n_neighbors: number of nearest neighbors for curvature; None takes 20, or more where the samples are noisy.
        sampling: "area": random, in proportion to area. "feature-size", "curvature" and "even" draw ten times as many
            and keep at most `n_samples` of them, as `Shape.downsample` does; areas are then known.
        generator: source of randomness; one number is taken from it at once to seed the samples. Seed 0 if None.

    Raises:
        ReadError: if the file is missing or malformed.
        InputError: on wrong shapes, faces out of range, vertices that are not finite, or a mesh without area.

    Example:
        >>> import topokit as tk
        >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
        >>> tk.from_mesh(vertices, faces).report().euler
        2
    """
    name, vertices, corners = _open(source, faces)
    check_sample_count(n_samples, given_or_default(n_neighbors))
    if sampling not in get_args(Sampling):
        raise InputError(f"sampling is {sampling!r}; expected one of {', '.join(map(repr, get_args(Sampling)))}.")
    started = time.perf_counter()
    positions = vertices.detach().cpu().numpy().astype(np.float64)
    counted = count_mesh(positions, corners)
    seconds = time.perf_counter() - started
    answer = mesh_answer(counted.topology, seconds, exact_vertices=counted.exact_vertices)
    used = torch.from_numpy(counted.topology.faces).to(vertices.device)
    seed = deferred_seed(generator)

    def samples() -> SurfaceSamples:
        return _samples(vertices, used, n_samples, sampling, torch.Generator().manual_seed(seed))

    return Shape(
        samples,
        answer,
        defects=partial(mesh_defects, positions, counted.faces),
        mesh=(vertices, used),
        name=name,
        notes=counted.notes,
        n_neighbors=n_neighbors,
    )


def _samples(
    vertices: Tensor, faces: Tensor, n_samples: int, sampling: Sampling, generator: torch.Generator
) -> SurfaceSamples:
    if sampling == "area":
        return sample_triangles(vertices, faces, n_samples, generator)[0]
    drawn, _ = sample_triangles(vertices, faces, _DRAWN_PER_SAMPLE * n_samples, generator)
    corners = vertices[faces]
    cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], dim=-1)
    share = cross.norm(dim=-1).sum() / 2 / drawn.n_points
    return fewer_samples(replace(drawn, areas=share.expand(drawn.n_points)), n_samples, sampling)


def _open(source: object, faces: object) -> tuple[str, Tensor, NDArray[np.int64]]:
    """What to call the mesh, its vertices and its triangles."""
    if faces is not None:
        return "mesh", _vertices(source), triangles(faces)
    if isinstance(source, str | os.PathLike):
        path = existing_file(source)
        with unpacked(path) as plain:
            vertices, corners = read_mesh(plain)
        return path.name, torch.from_numpy(vertices), corners
    if isinstance(source, tuple | list) and len(source) == 2:
        return "mesh", _vertices(source[0]), triangles(source[1])
    found = triangles_of(source)
    if found is None:
        raise InputError(
            f"from_mesh got {type(source).__name__}; expected a path, vertices and faces, a mesh of trimesh or open3d, "
            "or anything else with vertices and faces. For points use topokit.from_points."
        )
    return "mesh", _vertices(found[0]), triangles(found[1])


def _vertices(values: object) -> Tensor:
    vertices = as_floating(values, "vertices", "(V, 3)")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        hint = " Transpose them." if vertices.ndim == 2 and len(vertices) == 3 else ""
        raise InputError(f"vertices must have shape (V, 3), got {tuple(vertices.shape)}.{hint}")
    if not vertices.is_floating_point():
        raise InputError(f"vertices must be floating point, got {vertices.dtype}: call .double() or .float() on them.")
    return vertices
