"""Mesh files as other programs write them: strips, extra lists, negative indices, wrong counts, cells, objects."""

from __future__ import annotations

import gzip
import io
import itertools
import json
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from plyfile import PlyData, PlyElement

import topokit as tk
from topokit.adapters.points.entry import is_obj_cloud
from topokit.errors import InputError, ReadError
from topokit.inputs.cells import polygons_of_cells, polygons_of_list
from topokit.testing import icosphere, sphere_samples, torus_mesh

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
PLY = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
PLY_POINTS = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"


def euler_of(path: Path, content: str | bytes) -> tuple[int | None, str]:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    report = tk.load(path).report()
    return report.euler, report.verdict


# PLY


@pytest.mark.parametrize("strip", ["6 0 1 2 3 0 1", "15 0 2 1 -1 0 1 3 -1 0 3 2 -1 1 2 3", "10 0 1 2 3 0 1 -1 2 2 2"])
def test_triangle_strips_are_read(strip: str, tmp_path: Path) -> None:
    header = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    assert euler_of(tmp_path / "strip.ply", PLY + header + PLY_POINTS + strip + "\n") == (2, "certain")


def test_every_other_triangle_of_a_strip_is_turned(tmp_path: Path) -> None:
    """A closed strip whose triangles all agree needs no turning by the counter."""
    header = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(PLY + header + PLY_POINTS + "6 0 1 2 3 0 1\n")
    faces = tk.from_mesh(tmp_path / "a.ply").mesh[1]
    edges = {(int(a), int(b)) for face in faces for a, b in zip(face, face.roll(-1), strict=True)}
    assert len(edges) == 12


def test_faces_with_other_lists_and_strips_beside_them(tmp_path: Path) -> None:
    faces = (
        "element face 2\nproperty list uchar float texcoord\nproperty list uchar int vertex_index\nproperty int flags\n"
        "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    rows = "6 0 0 0 0 0 1 3 0 2 1 7\n0 3 0 1 3 7\n7 0 3 2 -1 1 2 3\n"
    assert euler_of(tmp_path / "both.ply", PLY + faces + PLY_POINTS + rows) == (2, "certain")


@pytest.mark.parametrize("options", [{"byte_order": "<"}, {"byte_order": ">"}, {"text": True}], ids=str)
@pytest.mark.parametrize("polygons", [QUADS, [*QUADS[1:], [0, 1, 3], [0, 3, 2]]], ids=["quads", "mixed"])
def test_polygons_with_and_without_other_lists(
    options: dict[str, Any], polygons: list[list[int]], tmp_path: Path
) -> None:
    vertex = np.array([tuple(p) for p in CORNERS], dtype=[(axis, "f4") for axis in "xyz"])
    for others in (0, 3):
        face = np.empty(len(polygons), dtype=[("vertex_indices", "O"), ("texcoord", "O")][: 1 + bool(others)])
        for row, corners in enumerate(polygons):
            face["vertex_indices"][row] = np.array(corners, dtype="i4")
            if others:
                face["texcoord"][row] = np.zeros(row % others, dtype="f4")
        kinds = {"vertex_indices": "i4", "texcoord": "f4"}
        elements = [PlyElement.describe(vertex, "vertex"), PlyElement.describe(face, "face", val_types=kinds)]
        PlyData(elements, **options).write(str(tmp_path / "box.ply"))
        report = tk.load(tmp_path / "box.ply").report()
        assert (report.euler, report.verdict) == (2, "certain")


def test_indices_beyond_the_vertices_are_refused(tmp_path: Path) -> None:
    header = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(PLY + header + PLY_POINTS + "3 0 1 4\n")
    with pytest.raises(ReadError, match="its faces name vertices 0 to 4, and it has 4"):
        tk.load(tmp_path / "a.ply")


# OBJ


@pytest.mark.parametrize(
    "content",
    [
        TETRAHEDRON + "f -4 -2 -3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -1 -2\nv 0 0 1\nf -4 -3 -1\nf -4 -1 -2\nf 2 3 4\n",
        TETRAHEDRON + "vn 0 0 1\nf -4//-1 -2//-1 -3//-1\nf 1//1 2//1 4//1\nf 1/2 4/3 3/1\nf 2 3 -1 # the last\n",
    ],
)
def test_negative_indices_count_from_the_face(content: str, tmp_path: Path) -> None:
    assert euler_of(tmp_path / "a.obj", content) == (2, "certain")


@pytest.mark.parametrize(
    ("face", "message"),
    [("f 0 1 2", "a face with vertex 0; OBJ files count vertices from 1"), ("f -5 1 2", "vertex -5, and 4 vertices")],
)
def test_indices_that_cannot_be_are_refused(face: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(TETRAHEDRON + face)
    with pytest.raises(ReadError, match=message):
        tk.load(tmp_path / "a.obj")


def test_an_obj_without_faces_is_a_cloud(tmp_path: Path) -> None:
    known = sphere_samples(200)
    rows = [f"v {x} {y} {z} 1 0 0\nvn {x} {y} {z}" for x, y, z in known.points.tolist()]
    for name, pack in (("a.obj", bytes), ("b.obj.gz", gzip.compress)):
        (tmp_path / name).write_bytes(pack("\n".join(rows).encode()))
        shape = tk.load(tmp_path / name)
        torch.testing.assert_close(shape.samples.points, known.points)
        assert shape.samples.normals is not None
    (tmp_path / "mesh.obj").write_text(TETRAHEDRON + "f 1 2 3\n")
    with pytest.raises(ReadError, match="has faces, or no vertices at all"):
        tk.from_points(tmp_path / "mesh.obj")


@pytest.mark.parametrize(
    ("content", "is_cloud"),
    [
        (b"v 0 0 1\nv 1 2 3", True),
        (b"# a\r\n \t v\t0 0 1\r\n", True),
        (b"v 0 0 1\n  f\t1 1 1", False),
        (b"f 1 1 1\nv 0 0 1\n", False),
        (b"f 1 1 1\n" + b"v 0 0 1\n" * 20_000, False),
        (b"v 0 0 1\n" * 20_000 + b"f 1 1 1\n", False),
        (b"v 0 0 1 # if\n#f 1 1 1\nvf 1\n", True),
        (b"vn 0 0 1\nfo 1\n", False),
    ],
)
def test_which_obj_is_a_cloud(content: bytes, is_cloud: bool, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(content)
    assert is_obj_cloud(tmp_path / "a.obj") is is_cloud


# STL and glTF


def binary_stl(announced: int, rest: bytes = b"") -> bytes:
    vertices, faces = icosphere(1)
    rows = np.zeros(len(faces), dtype=[("normal", "f4", 3), ("corners", "f4", (3, 3)), ("color", "u2")])
    rows["corners"] = np.asarray(vertices)[np.asarray(faces)]
    return b"\0" * 80 + struct.pack("<I", announced) + rows.tobytes() + rest


@pytest.mark.parametrize("content", [binary_stl(80), binary_stl(0), binary_stl(0xFFFFFFFF), binary_stl(80, b"by X")])
def test_counts_of_stl_that_nobody_filled_in(content: bytes, tmp_path: Path) -> None:
    assert euler_of(tmp_path / "a.stl", content) == (2, "certain")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"hello, this is a letter\n" * 20, "is text, and STL as text begins with 'solid'"),
        (b"hello", "is text, and STL as text begins with 'solid'"),
        (binary_stl(80)[:60], "has 60 bytes, and the header of a binary .stl file has 84: it is truncated"),
        (binary_stl(0)[:84], "holds no triangles"),
        (
            b"solid a\n facet normal 0 0 1\n  endloop\n endfacet\n facet",
            "'endsolid', after 1 triangles: it is truncated",
        ),
        (binary_stl(80)[:500], "announces 80 triangles and has bytes for 8: it is truncated"),
    ],
)
def test_what_is_no_whole_stl_is_called_so(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(content)
    with pytest.raises(ReadError, match=message):
        tk.load(tmp_path / "a.stl")


@pytest.mark.parametrize("announced", [79, 81, 10**6])
def test_counts_of_stl_that_contradict_the_file_are_refused(announced: int, tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(binary_stl(announced))
    with pytest.raises(ReadError, match=f"announces {announced} triangles and has bytes for 80"):
        tk.load(tmp_path / "a.stl")


@pytest.mark.parametrize(
    ("extension", "name"), [("KHR_draco_mesh_compression", "Draco"), ("EXT_meshopt_compression", "meshopt")]
)
@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_compressed_gltf_is_refused_by_name(extension: str, name: str, suffix: str, tmp_path: Path) -> None:
    text = json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": [extension]}).encode()
    text += b" " * (-len(text) % 4)
    head = b"glTF" + struct.pack("<III", 2, 20 + len(text), len(text)) + b"JSON"
    (tmp_path / f"a{suffix}").write_bytes(head + text if suffix == ".glb" else text)
    with pytest.raises(ReadError, match=f"compressed with {name} .*export it without compression"):
        tk.load(tmp_path / f"a{suffix}")


# finite elements and COLLADA

TETS = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])


@pytest.mark.parametrize("suffix", [".vtk", ".vtu", ".msh", ".inp", ".mesh", ".bdf", ".su2"])
def test_the_surface_of_solid_cells(suffix: str, tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio", reason="meshio is not installed; make test installs it")
    meshio.Mesh(POINTS, [("tetra", TETS)]).write(tmp_path / f"a{suffix}", "gmsh" if suffix == ".msh" else None)
    shape = tk.load(tmp_path / f"a{suffix}")
    assert len(shape.mesh[1]) == 6
    report = shape.report()
    assert (report.euler, report.verdict) == (2, "certain")
    content = (tmp_path / f"a{suffix}").read_bytes()
    (tmp_path / f"b{suffix}").write_bytes(content[: len(content) // 3])
    with pytest.raises(ReadError):
        tk.load(tmp_path / f"b{suffix}")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.vtk", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n", "PyVista"),
        ("a.vtu", '<?xml version="1.0"?><VTKFile type="PolyData">', "PyVista"),
        ("a.vtk", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\n", "holds a volume"),
        ("a.vtu", '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "b">]><VTKFile>', "defines XML entities"),
        ("a.dae", '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "b">]><COLLADA>', "defines XML entities"),
    ],
)
def test_what_meshio_would_misread_is_refused(name: str, content: str, message: str, tmp_path: Path) -> None:
    pytest.importorskip("meshio", reason="meshio is not installed; make test installs it")
    (tmp_path / name).write_text(content)
    with pytest.raises(ReadError, match=message):
        tk.load(tmp_path / name)


def test_collada(tmp_path: Path) -> None:
    pytest.importorskip("collada", reason="pycollada is not installed; make test installs it")
    trimesh.Trimesh(*torus_mesh(12, 8), process=False).export(tmp_path / "a.dae")
    assert tk.load(tmp_path / "a.dae").genus() == 1
    (tmp_path / "b.dae").write_bytes((tmp_path / "a.dae").read_bytes()[:900])
    with pytest.raises(ReadError):
        tk.load(tmp_path / "b.dae")


HEXAHEDRON = [[0, 1, 3, 2, 4, 5, 7, 6]]


@pytest.mark.parametrize(
    ("cells", "n_faces"),
    [
        ([("tetra", TETS), ("triangle", [[0, 1, 2]])], 6),
        ([("tetra10", np.hstack((TETS, np.full((2, 6), 4))))], 6),
        ([("hexahedron", HEXAHEDRON)], 6),
        ([("wedge", [[0, 1, 2, 4, 5, 6]])], 5),
        ([("pyramid", [[0, 1, 3, 2, 4]])], 5),
        ([("quad", QUADS), ("line", [[0, 1]])], 6),
        ([("triangle6", [[0, 1, 2, 3, 4, 5]]), ("quad", QUADS[:1]), ("polygon", [[0, 1, 2, 3, 4]])], 3),
        ([], 0),
    ],
)
def test_polygons_of_cells(cells: list[tuple[str, Any]], n_faces: int) -> None:
    assert len(polygons_of_cells(cells)) == n_faces
    solids = [name for name, _ in cells if name in ("hexahedron", "wedge", "pyramid")]
    if solids:
        assert tk.from_mesh(np.vstack((CORNERS, CORNERS + 9)), polygons_of_cells(cells)).report().verdict == "certain"


def test_cells_of_other_types_are_refused() -> None:
    with pytest.raises(InputError, match="cells of type 'polyhedron12'"):
        polygons_of_cells([("polyhedron12", [[0, 1, 2, 3]])])


def test_the_list_of_vtk() -> None:
    assert polygons_of_list([3, 0, 1, 2, 3, 2, 1, 0]).tolist() == [[0, 1, 2], [2, 1, 0]]
    assert polygons_of_list([3, 0, 1, 2, 4, 0, 1, 2, 3]).tolist() == [[0, 1, 2, -1], [0, 1, 2, 3]]
    assert polygons_of_list([]).shape == (0, 3)
    with pytest.raises(InputError, match="ends within face 1"):
        polygons_of_list([3, 0, 1, 2, 4, 0, 1])


# objects of other libraries, by the attributes that these have


def objects() -> dict[str, Any]:
    vertices, faces = (np.asarray(part) for part in torus_mesh(10, 6))
    tensors = torch.from_numpy(vertices), torch.from_numpy(faces)
    flat = np.insert(faces, 0, 3, axis=1).ravel()
    blocks = [SimpleNamespace(type="triangle", data=faces)]
    return {
        "PyTorch3D": SimpleNamespace(verts_list=lambda: [tensors[0]], faces_list=lambda: [tensors[1]]),
        "Kaolin": SimpleNamespace(vertices=tensors[0][None], faces=tensors[1], batching="fixed"),
        "PyVista": SimpleNamespace(points=vertices, faces=flat, n_strips=0),
        "vedo": SimpleNamespace(vertices=vertices, cells=faces.tolist()),
        "meshio": SimpleNamespace(points=vertices, cells=blocks, cells_dict={"triangle": faces}),
    }


@pytest.mark.parametrize("name", objects())
def test_meshes_of_other_libraries(name: str) -> None:
    assert tk.from_mesh(objects()[name]).report().genus == 1


def test_batches_of_meshes_are_refused() -> None:
    both = SimpleNamespace(verts_list=lambda: [1, 2], faces_list=lambda: [1, 2])
    with pytest.raises(InputError, match="the batch holds 2 meshes; pass one of them"):
        tk.from_mesh(both)


def test_a_mesh_of_meshio_itself() -> None:
    meshio = pytest.importorskip("meshio", reason="meshio is not installed; make test installs it")
    assert tk.load(meshio.Mesh(POINTS, [("tetra", TETS)])).report().euler == 2


def test_gradients_reach_the_vertices_of_other_libraries() -> None:
    vertices = torch.as_tensor(torus_mesh(10, 6)[0]).requires_grad_()
    faces = torch.as_tensor(torus_mesh(10, 6)[1])
    mesh = SimpleNamespace(verts_list=lambda: [vertices], faces_list=lambda: [faces])
    tk.from_mesh(mesh, n_samples=200).gauss_bonnet().backward()
    assert vertices.grad is not None
    assert vertices.grad.abs().max() > 0


def test_files_that_are_streams_are_of_the_mesh_they_hold() -> None:
    assert tk.load(io.BytesIO(binary_stl(80)), format="stl").report().euler == 2


@pytest.mark.parametrize("suffix", ["stl", "stl_ascii", "off", "ply", "glb", "3mf"])
def test_a_mesh_is_read_by_its_content_whatever_its_name(suffix: str, tmp_path: Path) -> None:
    """What content alone recognizes is read by content alone, too."""
    if suffix == "3mf":
        pytest.importorskip("lxml")
        pytest.importorskip("networkx")
    content = trimesh.Trimesh(*torus_mesh(12, 8), process=False).export(file_type=suffix)
    path = tmp_path / "torus"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    options = {"adapter": "mesh", "format": "stl"} if suffix == "stl" else {}  # binary STL has no beginning of its own
    assert tk.load(path, **options).report().euler == 0


def test_a_name_and_content_of_no_format_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_text("hello")
    with pytest.raises(ReadError, match=r"a\.bin is no mesh .* \.obj, \.off"):
        tk.from_mesh(tmp_path / "a.bin")
