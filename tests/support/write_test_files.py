"""Writes the small mesh files in tests/data: python tests/support/write_test_files.py

All are shapes of our own with known topology; about 110 kB together.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.testing import icosphere, joined, linked_tori_mesh, shell_mesh, torus_mesh
from topokit.testing.meshes import Mesh

DATA = Path(__file__).parents[1] / "data"
CUBE_QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def cube() -> Mesh:
    """The unit cube as six quads, facing outward."""
    return np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0], indexing="ij"), -1).reshape(-1, 3), CUBE_QUADS


def bowl() -> Mesh:
    """A sphere without its upper half: one boundary loop."""
    vertices, faces = icosphere(2)
    return vertices, faces[vertices[faces].mean(axis=1)[:, 2] < 0]


def edge_sharing_cubes() -> Mesh:
    """Two cubes with one edge in common, which then has four faces."""
    vertices, quads = joined(cube(), (cube()[0] + (1, 1, 0), CUBE_QUADS))
    _, first, place = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    return vertices[first], place.ravel()[quads]


def obj(mesh: Mesh) -> bytes:
    vertices, faces = mesh
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(index + 1) for index in face) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def off(mesh: Mesh) -> bytes:
    vertices, faces = mesh
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0", *(f"{x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices)]
    lines += [" ".join(map(str, (len(face), *face))) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def stl(mesh: Mesh) -> bytes:
    """Binary STL, zero normals: every triangle carries its own three corners."""
    vertices, faces = mesh
    records = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records["corners"] = vertices[faces]
    return b"topokit test file".ljust(80) + np.uint32(len(faces)).tobytes() + records.tobytes()


def ascii_stl(mesh: Mesh) -> bytes:
    vertices, faces = mesh
    lines = ["solid test"]
    for corners in vertices[faces]:
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners)]
        lines += ["endloop", "endfacet"]
    return ("\n".join([*lines, "endsolid test"]) + "\n").encode()


def ply(mesh: Mesh) -> bytes:
    """Binary little-endian PLY."""
    vertices, faces = mesh
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    rows = np.zeros(len(faces), dtype=[("count", "u1"), ("index", "<i4", faces.shape[1])])
    rows["count"], rows["index"] = faces.shape[1], faces
    return "\n".join(header).encode() + vertices.astype("<f4").tobytes() + rows.tobytes()


def reversed_faces(mesh: Mesh, which: NDArray[np.int64]) -> Mesh:
    """The mesh with some of its faces turned over."""
    vertices, faces = mesh[0], mesh[1].copy()
    faces[which] = faces[which, ::-1]
    return vertices, faces


FILES: dict[str, Callable[[], bytes]] = {
    "sphere.ply": lambda: ply(icosphere(2)),
    "torus.stl": lambda: stl(torus_mesh(20, 10)),
    "torus_ascii.stl": lambda: ascii_stl(torus_mesh(12, 6)),
    "cube_quads.obj": lambda: obj(cube()),
    "linked_tori.obj": lambda: obj(linked_tori_mesh(20, 10)),
    "hollow_ball.off": lambda: off(shell_mesh(2)),
    "bowl.obj": lambda: obj(bowl()),
    "flipped_faces.ply": lambda: ply(reversed_faces(icosphere(1), np.arange(10))),
    "edge_sharing_cubes.obj": lambda: obj(edge_sharing_cubes()),
    "unreferenced_vertex.obj": lambda: b"v 9 9 9\n" + obj((cube()[0], CUBE_QUADS + 1)),
    "truncated.stl": lambda: stl(torus_mesh(20, 10))[:5000],
    "wrong_index.obj": lambda: obj(cube()) + b"f 1 2 99\n",
    "no_faces.obj": lambda: obj((cube()[0], CUBE_QUADS[:0])),
}


def main() -> None:
    DATA.mkdir(exist_ok=True)
    for name, content in FILES.items():
        (DATA / name).write_bytes(content())


if __name__ == "__main__":
    main()
