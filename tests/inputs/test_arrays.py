"""What from_points and from_mesh take beside paths: arrays of any library, objects of trimesh, tensors with a graph."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from real_open3d import open3d_or_skip

import topokit as tk
from topokit.errors import InputError
from topokit.testing import icosphere, sphere_samples, torus_mesh

SPHERE = sphere_samples(400)


class ByDlpack:
    """An array of some other library: it can hand over its memory and say where that is, and nothing else."""

    def __init__(self, values: torch.Tensor) -> None:
        self.values = values

    def __dlpack__(self, **wishes: Any) -> object:
        return self.values.__dlpack__(**wishes)

    def __dlpack_device__(self) -> tuple[Any, int]:
        return self.values.__dlpack_device__()


class ByDlpackAlone:
    """The first version of the protocol, of which some libraries implement only this half."""

    def __init__(self, values: torch.Tensor) -> None:
        self.values = values

    def __dlpack__(self, stream: int | None = None) -> object:
        return self.values.__dlpack__()


class ByCapsule:
    """What came before the protocol, and what open3d has before 0.20."""

    def __init__(self, values: torch.Tensor) -> None:
        self.values = values

    def to_dlpack(self) -> object:
        return self.values.__dlpack__()


class ByArray:
    """An array of some other library that NumPy can read, in the old signature without dtype and copy."""

    def __init__(self, values: torch.Tensor) -> None:
        self.values = values

    def __array__(self) -> np.ndarray:
        return self.values.numpy()


class ByEither(ByArray):
    """DLPack is offered and refused, as for memory that is read-only."""

    def __dlpack__(self) -> object:
        raise BufferError("read-only")


class Refusing:
    def __dlpack__(self) -> object:
        raise BufferError("the memory is of no kind that anybody knows")


@pytest.mark.parametrize("library", [ByDlpack, ByDlpackAlone, ByCapsule])
def test_dlpack_shares_memory_and_keeps_the_type(library: type) -> None:
    for dtype in (torch.float32, torch.float64):
        points = SPHERE.points.to(dtype)
        taken = tk.from_points(library(points), library(SPHERE.normals.to(dtype))).samples
        assert taken.points.data_ptr() == points.data_ptr()
        assert taken.points.dtype == dtype
        assert torch.equal(taken.normals, SPHERE.normals.to(dtype))


@pytest.mark.parametrize("library", [ByArray, ByEither, torch.Tensor.numpy, torch.Tensor.tolist])
def test_what_numpy_reads_becomes_float64_and_is_copied(library: Any) -> None:
    points = SPHERE.points.float()
    taken = tk.from_points(library(points)).samples.points
    assert taken.dtype == torch.float64
    assert taken.data_ptr() != points.data_ptr()
    assert torch.equal(taken, points.double())


@pytest.mark.parametrize("library", [ByDlpack, ByDlpackAlone, ByCapsule, ByArray, ByEither, torch.Tensor.numpy])
@pytest.mark.parametrize("dtype", [torch.int16, torch.int64, torch.uint8])
def test_integer_arrays_become_float64(library: Any, dtype: torch.dtype) -> None:
    points = (100 * SPHERE.points + 101).to(dtype)
    taken = tk.from_points(library(points)).samples.points
    assert taken.dtype == torch.float64
    assert torch.equal(taken, points.double())


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_widened_with_its_graph(dtype: torch.dtype) -> None:
    points = SPHERE.points.to(dtype).requires_grad_()
    shape = tk.from_points(points, SPHERE.normals.to(dtype))
    assert shape.samples.points.dtype == shape.samples.normals.dtype == torch.float32
    shape.gauss_bonnet().backward()
    assert points.grad.dtype == dtype
    assert points.grad.isfinite().all()
    assert points.grad.abs().max() > 0
    assert tk.from_points(ByDlpack(points.detach())).samples.points.dtype == torch.float32
    assert tk.from_points(points.detach().float().numpy().astype(np.float16)).samples.points.dtype == torch.float64


def test_long_doubles_read_only_and_reversed_arrays_are_taken() -> None:
    points = SPHERE.points.numpy()
    fixed = points.copy()
    fixed.setflags(write=False)
    for array in (points.astype(np.longdouble), fixed, points[::-1][::-1], points.astype(">f8"), points.astype(object)):
        np.testing.assert_array_equal(tk.from_points(array).samples.points.numpy(), points)


def test_rows_that_are_not_finite_are_dropped_whatever_they_came_in() -> None:
    points = SPHERE.points.clone()
    points[:4] = torch.nan
    for library in (ByDlpack, ByArray):
        shape = tk.from_points(library(points))
        assert shape.samples.n_points == 396
        assert shape.notes == ("4 of 400 points are NaN or infinite and were dropped.",)


@pytest.mark.parametrize("library", [ByDlpack, ByDlpackAlone, ByCapsule, ByArray, ByEither])
def test_meshes_are_made_of_any_arrays(library: Any) -> None:
    vertices, faces = (torch.from_numpy(part) for part in torus_mesh())
    expected = tk.from_mesh((vertices, faces))
    shape = tk.from_mesh((library(vertices), library(faces.int())))
    assert torch.equal(shape.samples.points, expected.samples.points)
    assert shape.report().genus == 1
    assert tk.from_mesh((library(vertices.float()), faces)).samples.points.dtype == (
        torch.float32 if library in (ByDlpack, ByDlpackAlone, ByCapsule) else torch.float64
    )


@pytest.mark.parametrize("library", [ByDlpack, ByArray])
def test_volumes_are_made_of_any_arrays(library: Any) -> None:
    ring = torch.ones(5, 5, 3, dtype=torch.uint8)
    ring[2, 2] = 0
    assert tk.from_voxels(library(ring)).report().genus == 1


def test_objects_whose_vertices_have_a_graph_keep_it() -> None:
    vertices, faces = (torch.from_numpy(part) for part in torus_mesh(20, 10))
    moving = vertices.clone().requires_grad_()
    tk.from_mesh(SimpleNamespace(vertices=moving, faces=faces)).gauss_bonnet().backward()
    reference = vertices.clone().requires_grad_()
    tk.from_mesh((reference, faces)).gauss_bonnet().backward()
    assert torch.equal(moving.grad, reference.grad)
    assert moving.grad.abs().max() > 0
    cloud = SimpleNamespace(vertices=SPHERE.points.clone().requires_grad_())
    assert tk.from_points(cloud).samples.points is cloud.vertices


def test_trimesh_clouds_meshes_and_scenes() -> None:
    cloud = trimesh.PointCloud(SPHERE.points.numpy())
    assert torch.equal(tk.from_points(cloud).samples.points, SPHERE.points)
    mesh = trimesh.Trimesh(*icosphere(3), process=False)
    vertices = tk.from_points(mesh).samples
    assert vertices.normals is None
    np.testing.assert_array_equal(vertices.points.numpy(), mesh.vertices)
    scene = trimesh.Scene()
    for shift in (0.0, 5.0):
        scene.add_geometry(mesh, transform=trimesh.transformations.translation_matrix((shift, 0, 0)))
    report = tk.from_mesh(scene).report()
    assert (report.euler, report.components, report.verdict) == (4, 2, "certain")
    assert max(part.bounds[1][0] for part in report.per_component) == pytest.approx(6, abs=0.01)
    clouds = trimesh.Scene()
    for shift in (0.0, 5.0):
        clouds.add_geometry(cloud, transform=trimesh.transformations.translation_matrix((shift, 0, 0)))
    points = tk.from_points(clouds).samples.points
    assert len(points) == 800
    assert float(points[:, 0].max()) == pytest.approx(6, abs=0.1)


def test_load_opens_the_objects_of_trimesh() -> None:
    mesh = trimesh.Trimesh(*torus_mesh(), process=False)
    for source in (mesh, trimesh.Scene([mesh])):
        assert tk.load(source, n_samples=500).report().genus == 1
    assert torch.equal(tk.load(trimesh.PointCloud(SPHERE.points.numpy())).samples.points, SPHERE.points)


def test_normals_that_are_given_win_over_those_of_an_object() -> None:
    o3d = open3d_or_skip()

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(SPHERE.points.numpy()))
    cloud.normals = o3d.utility.Vector3dVector(-SPHERE.normals.numpy())
    assert torch.equal(tk.from_points(cloud).samples.normals, -SPHERE.normals)
    assert torch.equal(tk.from_points(cloud, SPHERE.normals).samples.normals, SPHERE.normals)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (
            object(),
            "from_points got object; expected a path, a tensor or array (N, 3), anything with __dlpack__ or __array__, "
            "a data frame, or a point cloud of open3d, trimesh, PyTorch3D, PyVista or vedo.",
        ),
        (
            Refusing(),
            "points: Refusing could not be converted through DLPack (the memory is of no kind that anybody knows); "
            "convert it to a tensor or a NumPy array first.",
        ),
        (np.zeros((9, 3), complex), "points must hold real numbers, got torch.complex128; expected shape (N, 3)."),
        (
            ByDlpack(torch.zeros(9, 3, dtype=torch.complex64)),
            "points must hold real numbers, got torch.complex64; expected shape (N, 3).",
        ),
        (
            [["a", "b", "c"]],
            "points could not be read as numbers (they are <U1); expected shape (N, 3).",
        ),
        (ByDlpack(torch.zeros(9)), "points must have shape (N, 3), or (..., N, 3) for batches, got (9,)."),
        (
            torch.zeros(50, 3, dtype=torch.int32),
            "points must be a floating-point tensor, got torch.int32: call .double() or .float() on it.",
        ),
        (
            trimesh.PointCloud(np.eye(9, 3)),
            "points has 9 points, too few for 20 neighbors each: give at least 21, "
            "or pass a smaller n_neighbors (3 to 8).",
        ),
    ],
)
def test_what_cannot_be_taken_as_points_is_explained(points: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        tk.from_points(points)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            trimesh.PointCloud(np.zeros((9, 3))),
            "from_mesh got PointCloud; expected a path, vertices and faces, a mesh of trimesh or open3d, or "
            "anything else with vertices and faces. For points use topokit.from_points.",
        ),
        (
            np.zeros((9, 3)),
            "from_mesh got ndarray; expected a path, vertices and faces, a mesh of trimesh or open3d, or "
            "anything else with vertices and faces. For points use topokit.from_points.",
        ),
        (trimesh.Scene(), "the mesh has no faces; for points alone use topokit.from_points."),
        (
            (Refusing(), [[0, 1, 2]]),
            "vertices: Refusing could not be converted through DLPack (the memory is of no kind that anybody knows); "
            "convert it to a tensor or a NumPy array first.",
        ),
        (
            (np.zeros((3, 3)), ByArray(torch.full((1, 3), 0.5))),
            "faces must be whole numbers, got float32. For points and normals use topokit.from_points.",
        ),
    ],
)
def test_what_cannot_be_taken_as_a_mesh_is_explained(source: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        tk.from_mesh(source)
    assert str(caught.value) == message
