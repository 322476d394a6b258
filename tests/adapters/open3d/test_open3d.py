"""open3d in and out, against the real one: the same shapes as by arrays, colors, attributes, and what is missing."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from real_open3d import open3d_or_skip

import topokit as tk
from topokit.adapters.open3d.adapter import from_open3d
from topokit.errors import InputError, MissingDependencyError
from topokit.export import open3d as export
from topokit.export import to_open3d
from topokit.export.colors import diverging_colors
from topokit.testing import icosphere, sphere_samples, torus_mesh, torus_samples

o3d = open3d_or_skip()

ROOT = Path(__file__).resolve().parents[3]
TORUS = torus_samples(2000)


def legacy_cloud(points: torch.Tensor, normals: torch.Tensor | None = None) -> Any:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.numpy()))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals.numpy())
    return cloud


def tensor_cloud(points: torch.Tensor, normals: torch.Tensor | None = None) -> Any:
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points.numpy()))
    if normals is not None:
        cloud.point["normals"] = o3d.core.Tensor(normals.numpy())
    return cloud


def legacy_mesh(vertices: np.ndarray, faces: np.ndarray) -> Any:
    return o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces))


def tensor_mesh(vertices: np.ndarray, faces: np.ndarray) -> Any:
    return o3d.t.geometry.TriangleMesh(o3d.core.Tensor(vertices), o3d.core.Tensor(faces))


def ring_of_voxels(size: float = 0.25, origin: tuple[float, float, float] = (-7.0, 3.0, 100.0)) -> Any:
    """12 × 12 × 4 voxels without the 4 × 4 in the middle: a solid torus."""
    grid = o3d.geometry.VoxelGrid()
    grid.voxel_size, grid.origin = size, origin
    for x, y, z in np.ndindex(12, 12, 4):
        if not (4 <= x < 8 and 4 <= y < 8):
            grid.add_voxel(o3d.geometry.Voxel(np.array([x - 3, y, z])))
    return grid


# In


@pytest.mark.parametrize("make", [legacy_cloud, tensor_cloud])
@pytest.mark.parametrize("opener", [tk.load, tk.from_points])
@pytest.mark.parametrize("with_normals", [False, True])
def test_clouds_are_what_their_arrays_are(make: Any, opener: Any, with_normals: bool) -> None:
    normals = TORUS.normals if with_normals else None
    taken = opener(make(TORUS.points, normals), n_neighbors=16)
    expected = tk.from_points(TORUS.points, normals, n_neighbors=16)
    assert torch.equal(taken.samples.points, expected.samples.points)
    assert taken.samples.oriented == with_normals
    if with_normals:
        assert torch.equal(taken.samples.normals, TORUS.normals)
    assert taken.gauss_bonnet() == expected.gauss_bonnet()


@pytest.mark.parametrize("make", [legacy_mesh, tensor_mesh])
@pytest.mark.parametrize("opener", [tk.load, tk.from_mesh])
def test_meshes_are_what_their_arrays_are(make: Any, opener: Any) -> None:
    taken, expected = opener(make(*torus_mesh()), n_samples=500), tk.from_mesh(torus_mesh(), n_samples=500)
    assert torch.equal(taken.samples.points, expected.samples.points)
    report = taken.report()
    assert (report.euler, report.genus, report.verdict) == (0, 1, "certain")


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_tensors_keep_their_type_and_share_their_memory(dtype: torch.dtype) -> None:
    cloud = tensor_cloud(TORUS.points.to(dtype), TORUS.normals.to(dtype))
    samples = tk.load(cloud).samples
    assert samples.points.dtype == samples.normals.dtype == dtype
    cloud.point["positions"][0] = 9.0
    assert samples.points[0].tolist() == [9, 9, 9]
    del cloud
    torch.testing.assert_close(samples.points[1:], TORUS.points.to(dtype)[1:], rtol=0, atol=0)
    mesh = tensor_mesh(torus_mesh()[0].astype(np.float32), torus_mesh()[1].astype(np.int32))
    assert tk.load(mesh).samples.points.dtype == torch.float32


def test_a_mesh_asked_for_points_gives_its_vertices() -> None:
    vertices, faces = icosphere(3)
    for mesh in (legacy_mesh(vertices, faces), tensor_mesh(vertices, faces)):
        mesh.compute_vertex_normals()
        samples = tk.from_points(mesh).samples
        np.testing.assert_array_equal(samples.points.numpy(), vertices)
        assert samples.normals is None


def test_rows_that_are_not_finite_are_dropped() -> None:
    points = TORUS.points.clone()
    points[:5] = torch.nan
    assert tk.load(legacy_cloud(points)).notes == ("5 of 2000 points are NaN or infinite and were dropped.",)


def test_voxels_lie_where_their_grid_lies() -> None:
    grid = ring_of_voxels()
    shape = tk.load(grid, n_samples=4000)
    report = shape.report()
    assert (report.euler, report.genus, report.verdict) == (0, 1, "certain")
    assert "26-connected foreground" in report.reasons[0]
    assert not any("border" in reason for reason in report.reasons)
    low, high = np.array(report.per_component[0].bounds)
    centers = np.array([grid.get_voxel_center_coordinate(voxel.grid_index) for voxel in grid.get_voxels()])
    np.testing.assert_allclose(low, centers.min(axis=0) - 0.125)
    np.testing.assert_allclose(high, centers.max(axis=0) + 0.125)
    np.testing.assert_allclose(low, (-7.75, 3, 100))
    points = shape.samples.points.numpy()
    np.testing.assert_allclose(points.min(axis=0), low, atol=0.1)
    np.testing.assert_allclose(points.max(axis=0), high, atol=0.1)
    assert shape.field.grid.origin == pytest.approx((-7.75 - 0.125, 3 - 0.125, 100 - 0.125))


def test_connectivity_of_voxels_can_be_chosen() -> None:
    grid = o3d.geometry.VoxelGrid()
    grid.voxel_size = 1.0
    for index in ((0, 0, 0), (1, 1, 1)):
        grid.add_voxel(o3d.geometry.Voxel(np.array(index)))
    assert tk.load(grid).report().components == 1
    assert tk.load(grid, connectivity=6).report().components == 2


def test_a_voxelised_surface_is_a_shell() -> None:
    grid = o3d.geometry.VoxelGrid.create_from_triangle_mesh(legacy_mesh(*icosphere(3)), 0.2)
    report = tk.load(grid).report()
    assert (report.euler, report.components, report.cavities) == (4, 2, 1)


def test_the_list_names_it_and_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def row() -> Any:
        return next(one for one in tk.list_adapters() if one.name == "open3d")

    assert (row().usable, row().install, row().suffixes) == (True, None, ())
    assert "open3d.t.geometry.TriangleMesh" in row().types
    monkeypatch.setitem(sys.modules, "open3d", None)
    assert (row().usable, row().install) == (False, 'pip install "topokit[open3d]"')


# Out


def test_a_cloud_comes_back_with_normals_and_colors() -> None:
    shape = tk.load(legacy_cloud(TORUS.points, TORUS.normals))
    cloud = to_open3d(shape)
    assert type(cloud) is o3d.geometry.PointCloud
    np.testing.assert_array_equal(np.asarray(cloud.points), TORUS.points.numpy())
    np.testing.assert_allclose(np.asarray(cloud.normals), TORUS.normals.numpy(), atol=1e-12)
    expected = diverging_colors(shape.curvature().gaussian.numpy())
    np.testing.assert_allclose(np.asarray(cloud.colors), expected / 255, atol=1e-7)
    red, _, blue = np.asarray(cloud.colors).T
    known = TORUS.gaussian.numpy()
    assert np.mean((red > blue)[known > 0.5]) > 0.99
    assert np.mean((red < blue)[known < -0.5]) > 0.99
    again = tk.load(cloud)
    assert again.gauss_bonnet() == pytest.approx(float(shape.gauss_bonnet()), abs=1e-9)


def test_a_mesh_stays_a_mesh() -> None:
    vertices, faces = torus_mesh()
    for make in (legacy_mesh, tensor_mesh):
        mesh = to_open3d(tk.load(make(vertices, faces)), "mean")
        assert type(mesh) is o3d.geometry.TriangleMesh
        np.testing.assert_array_equal(np.asarray(mesh.vertices), vertices)
        np.testing.assert_array_equal(np.asarray(mesh.triangles), faces)
        assert mesh.is_watertight()
        outward = vertices - vertices * (1, 1, 0) / np.hypot(*vertices.T[:2])[:, None]
        assert (np.sum(np.asarray(mesh.vertex_normals) * outward, axis=1) > 0.35).all()
        red, _, blue = np.asarray(mesh.vertex_colors).T
        assert np.mean(red > blue) > 0.99  # H is positive all over this torus


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_tensor_api_carries_the_numbers(dtype: torch.dtype, tmp_path: Path) -> None:
    shape = tk.from_points(TORUS.points.to(dtype, copy=True).requires_grad_(), TORUS.normals.to(dtype))
    cloud = to_open3d(shape, "total", tensor=True)
    assert type(cloud) is o3d.t.geometry.PointCloud
    names = {"positions", "normals", "colors", "gaussian", "mean", "total", "k_min", "k_max", "area"}
    assert {name for name, _ in cloud.point.items()} == names
    local = shape.curvature()
    expected = {
        "positions": shape.samples.points,
        "normals": local.normals,
        "gaussian": local.gaussian[:, None],
        "mean": local.mean[:, None],
        "total": local.total[:, None],
        "k_min": local.principal[:, :1],
        "k_max": local.principal[:, 1:],
        "area": local.area[:, None],
    }
    for name, values in expected.items():
        torch.testing.assert_close(torch.from_numpy(cloud.point[name].numpy()), values.detach(), rtol=1e-6, atol=1e-7)
    path = str(tmp_path / "cloud.ply")
    assert o3d.t.io.write_point_cloud(path, cloud)
    read = o3d.t.io.read_point_cloud(path)
    np.testing.assert_allclose(read.point["gaussian"].numpy(), cloud.point["gaussian"].numpy())


def test_a_mesh_in_the_tensor_api() -> None:
    mesh = to_open3d(tk.from_mesh(torus_mesh()), tensor=True)
    assert type(mesh) is o3d.t.geometry.TriangleMesh
    np.testing.assert_array_equal(mesh.triangle["indices"].numpy(), torus_mesh()[1])
    area = mesh.vertex["area"].numpy()
    assert area.shape == (len(torus_mesh()[0]), 1)
    assert area.mean() * 10_000 == pytest.approx(4 * np.pi**2 * 0.4, rel=0.1)
    assert tk.load(mesh).genus() == 1


def test_moving_the_geometry_leaves_the_shape_alone() -> None:
    points = TORUS.points.clone()
    to_open3d(tk.from_points(points), tensor=True).translate(o3d.core.Tensor([5.0, 0, 0]))
    to_open3d(tk.from_points(points)).translate((5, 0, 0))
    assert torch.equal(points, TORUS.points)


def test_fields_and_voxels_come_out_as_their_samples() -> None:
    ball = tk.from_sdf(lambda p: p.norm(dim=-1) - 0.7, n_samples=1000)
    assert len(to_open3d(ball).points) == 1000
    ring = to_open3d(tk.load(ring_of_voxels(), n_samples=1000), tensor=True)
    assert ring.point["positions"].shape[0] == 1000


@pytest.mark.long
def test_the_example_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    output = tmp_path / "cloud.ply"
    monkeypatch.setattr(sys, "argv", ["open3d_roundtrip.py", str(output)])
    runpy.run_path(str(ROOT / "examples" / "open3d_roundtrip.py"), run_name="__main__")
    assert "genus 1" in capsys.readouterr().out
    assert o3d.io.read_point_cloud(str(output)).has_colors()


# Refusals


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        (o3d.geometry.VoxelGrid(), "the VoxelGrid has no voxels."),
        (
            o3d.geometry.PointCloud(),
            "points has 0 points, too few for 20 neighbors each: give at least 21.",
        ),
        (
            o3d.t.geometry.PointCloud(),
            "from_open3d got PointCloud; expected a PointCloud or a TriangleMesh with positions, or a VoxelGrid.",
        ),
        (o3d.geometry.TriangleMesh(), "the mesh has no faces; for points alone use topokit.from_points."),
    ],
)
def test_empty_geometries_are_explained(geometry: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        tk.load(geometry)
    assert str(caught.value) == message


def test_other_geometries_are_explained() -> None:
    for geometry in (o3d.geometry.LineSet(), o3d.geometry.Image(np.zeros((2, 2), np.uint8))):
        with pytest.raises(InputError, match=f"^from_open3d got {type(geometry).__name__}; expected a PointCloud or"):
            from_open3d(geometry)


def test_rotated_and_boundless_grids_are_explained() -> None:
    grid = ring_of_voxels()
    if not hasattr(grid, "rotation"):
        pytest.skip(f"voxel grids of open3d {o3d.__version__} cannot be rotated")
    grid.rotate(grid.get_rotation_matrix_from_xyz((0.1, 0.2, 0.3)), center=(0, 0, 0))
    with pytest.raises(InputError, match=r"^the VoxelGrid is rotated, and topokit's volumes lie along the axes: undo"):
        tk.load(grid)
    grid.rotate(grid.rotation.T, center=(0, 0, 0))
    assert tk.load(grid).report().per_component[0].bounds[0] == pytest.approx((-7.75, 3, 100))
    grid.add_voxel(o3d.geometry.Voxel(np.array([30_000, 2_000, 100])))
    with pytest.raises(InputError) as caught:
        tk.load(grid)
    assert str(caught.value) == (
        "the VoxelGrid spans 30006 × 2003 × 103 cells, too many for a volume: use larger voxels, or remove those that "
        "lie far away."
    )


def test_bad_colors_and_batches_are_explained() -> None:
    with pytest.raises(InputError) as caught:
        to_open3d(tk.from_points(TORUS.points), "blue")  # type: ignore[arg-type]
    assert str(caught.value) == "color_by is 'blue'; expected 'gaussian', 'mean' or 'total'."
    with pytest.raises(InputError, match=r"^one shape is exported at a time; the samples are batched, \(2, 400, 3\)\."):
        to_open3d(tk.from_points(torch.stack([sphere_samples(400).points] * 2)))


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(MissingDependencyError) as caught:
        to_open3d(tk.from_points(TORUS.points))
    assert str(caught.value) == 'to_open3d needs open3d, which is not installed: pip install "topokit[open3d]".'


BROKEN = {
    "libGL.so.1: cannot open shared object file: No such file or directory": (
        "open3d is installed, but system libraries that it loads are missing: libGL.so.1. "
        "On Debian and Ubuntu: sudo apt-get install libgl1."
    ),
    "libX11.so.6: cannot open shared object file: No such file or directory": (
        "open3d is installed, but system libraries that it loads are missing: libX11.so.6. "
        "On Debian and Ubuntu: apt-file search libX11.so.6 names the package of libX11.so.6."
    ),
    "undefined symbol: _ZN4tbb": (
        "open3d is installed but could not be loaded (undefined symbol: _ZN4tbb). Install it again: "
        'pip install "topokit[open3d]".'
    ),
}


@pytest.mark.parametrize("error", ["OSError", "ImportError"])
@pytest.mark.parametrize("said", BROKEN)
def test_a_library_that_open3d_lacks_is_named(
    error: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package that fails as the linker makes open3d fail takes its place."""
    (tmp_path / "open3d.py").write_text(f"raise {error}({said!r})", encoding="utf-8")
    monkeypatch.delitem(sys.modules, "open3d")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingDependencyError) as caught:
        to_open3d(tk.from_mesh(icosphere(1)))
    assert str(caught.value) == BROKEN[said]


def test_all_libraries_that_are_missing_are_named_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_library(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(export.ctypes, "CDLL", no_library)
    assert export._what_is_missing("libEGL.so.1: cannot open shared object file: No such file or directory") == (
        "open3d is installed, but system libraries that it loads are missing: libEGL.so.1, libusb-1.0.so.0, "
        "libGL.so.1, libgomp.so.1. On Debian and Ubuntu: sudo apt-get install libegl1 libusb-1.0-0 libgl1 libgomp1."
    )


def test_the_libraries_are_those_that_make_test_installs() -> None:
    script = (ROOT / ".ci" / "system-libraries").read_text(encoding="utf-8")
    assert dict(re.findall(r"^has (\S+) \|\| packages=\"\$packages (\S+)\"", script, re.MULTILINE)) == (
        export._DEBIAN_PACKAGES
    )
