"""from_points: sources, files, normals, and refusals."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.errors import GenusError, InputError, ReadError, UnknownFormatError
from topokit.testing import sphere_samples

SPHERE = sphere_samples(400)
TABLE = torch.cat((SPHERE.points, SPHERE.normals), dim=1).numpy()


def write(path: Path, table: np.ndarray) -> None:
    columns = ["x", "y", "z", "nx", "ny", "nz"][: table.shape[1]]
    match path.suffix:
        case ".npy":
            np.save(path, table)
        case ".npz":
            np.savez(path, points=table[:, :3], **({"normals": table[:, 3:]} if table.shape[1] == 6 else {}))
        case ".ply":
            header = "".join(f"property double {name}\n" for name in columns)
            start = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{header}end_header\n"
            path.write_bytes(start.encode() + table.astype("<f8").tobytes())
        case ".pcd":
            names = [{"n": "normal_"}.get(name[0], "") + name[-1] for name in columns]
            header = f"FIELDS {' '.join(names)}\nSIZE {'8 ' * len(names)}\nTYPE {'F ' * len(names)}\n"
            header += f"COUNT {'1 ' * len(names)}\nWIDTH {len(table)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
            start = (
                f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n{header}POINTS {len(table)}\nDATA binary\n"
            )
            path.write_bytes(start.encode() + table.astype("<f8").tobytes())
        case ".las":
            laspy = pytest.importorskip("laspy")
            file = laspy.create(point_format=0, file_version="1.2")
            file.header.scales = [1e-6] * 3
            file.x, file.y, file.z = table[:, :3].T
            file.write(path)
        case ".csv":
            path.write_text(",".join(columns) + "\n" + "\n".join(",".join(map(repr, row)) for row in table.tolist()))
        case ".pwn":
            path.write_text(f"{len(table)}\n" + "\n".join(" ".join(map(repr, row)) for row in table.tolist()))
        case _:
            path.write_text("# a comment\n" + "\n".join(" ".join(map(repr, row)) for row in table.tolist()))


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv", ".pwn", ".npy", ".npz", ".ply", ".pcd", ".las"])
@pytest.mark.parametrize("width", [3, 6])
def test_every_format_brings_its_points_and_normals(suffix: str, width: int, tmp_path: Path) -> None:
    path = tmp_path / f"cloud{suffix}"
    write(path, TABLE[:, :width])
    for shape in (tk.from_points(path), tk.load(path)):
        np.testing.assert_allclose(shape.samples.points.numpy(), TABLE[:, :3], atol=1e-6)
        if width == 6 and suffix != ".las":
            assert shape.samples.normals is not None
            np.testing.assert_allclose(shape.samples.normals.numpy(), TABLE[:, 3:], atol=1e-9)
        else:
            assert shape.samples.normals is None


def test_colours_are_not_taken_for_normals(tmp_path: Path) -> None:
    path = tmp_path / "coloured.xyz"
    write(path, np.c_[TABLE[:, :3], np.random.default_rng(0).integers(0, 256, (400, 3))])
    assert tk.load(path).samples.normals is None


def test_tensors_keep_dtype_and_gradient() -> None:
    points = SPHERE.points.float().requires_grad_()
    shape = tk.from_points(points, SPHERE.normals.float())
    assert shape.samples.points is points
    shape.euler().backward()
    assert points.grad is not None
    assert points.grad.dtype == torch.float32


def test_an_open_cloud_says_where_and_has_no_genus() -> None:
    known = sphere_samples(6000)
    upper = known.points[:, 2] > 0
    shape = tk.from_points(known.points[upper], known.normals[upper])
    report = shape.report()
    assert not report.closed
    assert report.genus is None
    assert any("not closed" in reason for reason in report.reasons)
    with pytest.raises(GenusError, match=r"no genus that topokit can vouch for.*not closed"):
        shape.genus()


def test_rows_that_are_not_finite_are_dropped_and_counted() -> None:
    points = SPHERE.points.clone()
    points[::10] = torch.nan
    shape = tk.from_points(points, SPHERE.normals)
    assert shape.samples.n_points == 360
    assert "40 of 400 points are NaN or infinite and were dropped." in shape.report().reasons
    points[:300] = torch.inf
    with pytest.raises(
        InputError, match=r"of 400 points are NaN or infinite\. A cloud of which most is missing is refused"
    ):
        tk.from_points(points)


def test_useless_normals_are_noticed() -> None:
    normals = SPHERE.normals.clone()
    normals[0] = 0
    shape = tk.from_points(SPHERE.points, normals)
    assert shape.samples.n_points == 399
    shape = tk.from_points(SPHERE.points, torch.zeros_like(normals))
    assert shape.samples.normals is None
    assert "400 of 400 normals are zero or not finite; all normals were put aside." in shape.report().reasons


def test_batches_have_euler_but_no_single_report() -> None:
    shape = tk.from_points(torch.stack((SPHERE.points, 2 * SPHERE.points)))
    assert shape.euler().shape == (2,)
    with pytest.raises(InputError, match="a report is about one shape; the samples are batched"):
        shape.report()


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((5, 2)), r"points must have shape \(N, 3\).*got \(5, 2\)"),
        (torch.zeros(50, 3, dtype=torch.int32), "must be a floating-point tensor, got torch.int32: call .double"),
        (SPHERE.points[:20], "20 points, too few for 20 neighbours each: give at least 21"),
        ([["a", "b", "c"]], "could not be read as numbers"),
        (None, r"from_points got NoneType; expected a path, a tensor or array \(N, 3\), anything with __dlpack__"),
    ],
)
def test_bad_points_are_explained(points: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        tk.from_points(points)  # type: ignore[arg-type]


def test_normals_of_another_shape_are_explained() -> None:
    with pytest.raises(InputError, match=r"normals must have the shape of the points, \(400, 3\), got \(399, 3\)"):
        tk.from_points(SPHERE.points, SPHERE.normals[1:])


@pytest.mark.parametrize(
    ("name", "content", "error", "message"),
    [
        ("words.txt", b"no numbers in here\n", ReadError, "holds no row of at least three numbers"),
        ("ragged.xyz", b"1 2 3\n4 5\n", ReadError, "could not be read by the text reader"),
        ("flat.npy", None, ReadError, r"has shape \(7,\); \(N, 3\) for points or \(N, 6\)"),
        ("cut.npy", b"\x93NUMPY\x01\x00v\x00{'descr'", ReadError, "could not be read"),
        (
            "cut.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\nproperty float x\nend_header\n",
            ReadError,
            "could not be read|not a readable",
        ),
        ("cut.pcd", b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\n", ReadError, "could not be read"),
        ("cut.las", b"LASF" + struct.pack("<I", 7), ReadError, "could not be read"),
        ("what.xyz2", b"1 2 3\n", UnknownFormatError, r"'.xyz2' is not a known format.*Known: .3mf, .asc"),
        ("archive.zip", b"PK\x03\x04 something else", UnknownFormatError, "is a zip archive: unpack it first"),
    ],
)
def test_broken_files_are_explained(
    name: str, content: bytes | None, error: type[Exception], message: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    if content is None:
        np.save(path, np.zeros(7))
    else:
        path.write_bytes(content)
    with pytest.raises(error, match=message):
        tk.load(path)


def test_pickled_arrays_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "objects.npy"
    np.save(path, np.array([{"code": "runs"}], dtype=object), allow_pickle=True)
    with pytest.raises(ReadError, match="could not be read"):
        tk.load(path)


def test_missing_files_directories_and_names(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="does not exist"):
        tk.load(tmp_path / "nowhere.ply")
    with pytest.raises(ReadError, match=r"is a directory"):
        tk.load(tmp_path)
    with pytest.raises(InputError, match=r"adapter 'meshes' is not known. Known: mesh, points"):
        tk.load(__file__, adapter="meshes")
