"""from_points: sources, files, normals, and refusals."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.adapters.points.files import read_points
from topokit.errors import GenusError, InputError, MissingDependencyError, ReadError, UnknownFormatError
from topokit.testing import sphere_samples

SPHERE = sphere_samples(400)
TABLE = torch.cat((SPHERE.points, SPHERE.normals), dim=1).numpy()


def write(path: Path, table: np.ndarray) -> None:
    columns = ["x", "y", "z", "nx", "ny", "nz"][: table.shape[1]]
    match path.suffix:
        case ".npy":
            np.save(path, table)
        case ".npz":
            if table.shape[1] == 6:
                np.savez(path, points=table[:, :3], normals=table[:, 3:])
            else:
                np.savez(path, points=table)
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


def test_colors_are_not_taken_for_normals(tmp_path: Path) -> None:
    path = tmp_path / "colored.xyz"
    write(path, np.c_[TABLE[:, :3], np.random.default_rng(0).integers(0, 256, (400, 3))])
    assert tk.load(path).samples.normals is None


def test_tensors_keep_dtype_and_gradient() -> None:
    points = SPHERE.points.float().requires_grad_()
    shape = tk.from_points(points, SPHERE.normals.float())
    assert shape.samples.points is points
    shape.gauss_bonnet().backward()
    assert points.grad is not None
    assert points.grad.dtype == torch.float32


def test_an_open_cloud_says_where_and_has_the_genus_of_its_numbers() -> None:
    known = sphere_samples(2000)
    upper = known.points[:, 2] > 0
    shape = tk.from_points(known.points[upper], known.normals[upper])
    report = shape.report()
    assert not report.closed
    assert (report.euler, report.components, report.boundary_loops, report.genus) == (1, 1, 1, 0)
    assert any("not closed" in reason for reason in report.reasons)
    assert shape.genus() == 0


def test_points_on_no_surface_have_no_genus_and_the_error_names_the_next_call() -> None:
    line = torch.linspace(0, 1, 200, dtype=torch.float64)[:, None].expand(200, 3).clone()
    with pytest.raises(GenusError, match=r"genus is undefined or unknown\. No solid .* shape\.report\(\)"):
        tk.from_points(line).genus()


def test_rows_that_are_not_finite_are_dropped_and_counted() -> None:
    points = SPHERE.points.clone()
    points[::10] = torch.nan
    shape = tk.from_points(points, SPHERE.normals)
    assert shape.samples.n_points == 360
    assert "40 of 400 points are NaN or infinite and were dropped." in shape.report().reasons
    points[:300] = torch.inf
    with pytest.raises(InputError, match=r"of 400 points are NaN or infinite\. More than half of the cloud is invalid"):
        tk.from_points(points)


def test_useless_normals_are_noticed() -> None:
    normals = SPHERE.normals.clone()
    normals[0] = 0
    shape = tk.from_points(SPHERE.points, normals)
    assert shape.samples.n_points == 399
    shape = tk.from_points(SPHERE.points, torch.zeros_like(normals))
    assert shape.samples.normals is None
    assert "400 of 400 normals are zero or not finite; all normals were ignored." in shape.report().reasons


def test_batches_have_euler_but_no_single_report() -> None:
    shape = tk.from_points(torch.stack((SPHERE.points, 2 * SPHERE.points)))
    assert shape.gauss_bonnet().shape == (2,)
    with pytest.raises(InputError, match="a report is about one shape; the samples are batched"):
        shape.report()


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((5, 2)), r"points must have shape \(N, 3\).*got \(5, 2\)"),
        (torch.zeros(50, 3, dtype=torch.int32), "must be a floating-point tensor, got torch.int32: call .double"),
        (SPHERE.points[:20], "20 points, too few for 20 neighbors each: give at least 21, or .*3 to 19"),
        (SPHERE.points[:4], "4 points, too few for 20 neighbors each: give at least 21[.]$"),
        (SPHERE.points[:1], "1 point, too few"),
        (SPHERE.points.T, r"got \(3, 400\)\. Transpose"),
        (torch.cat((SPHERE.points, SPHERE.normals), dim=1), r"got \(400, 6\)\. Normals are the second argument"),
        (torch.ones(100, 3), r"all 100 points are at \(1.0, 1.0, 1.0\)"),
        ([["a", "b", "c"]], "could not be read as numbers"),
        (None, r"from_points got NoneType; expected a path, a tensor or array \(N, 3\), anything with __dlpack__"),
    ],
)
def test_bad_points_are_explained(points: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        tk.from_points(points)


def test_normals_of_another_shape_are_explained() -> None:
    with pytest.raises(InputError, match=r"normals must have the shape of the points, \(400, 3\), got \(399, 3\)"):
        tk.from_points(SPHERE.points, SPHERE.normals[1:])


@pytest.mark.parametrize(
    ("name", "content", "error", "message"),
    [
        ("words.txt", b"no numbers in here\n", ReadError, "holds no row of at least three numbers"),
        ("ragged.xyz", b"1 2 3\n4 5\n", ReadError, "could not be read by the text reader .*invalid column index"),
        ("flat.npy", None, ReadError, r"has shape \(7,\); \(N, 3\) for points or \(N, 6\)"),
        ("cut.npy", b"\x93NUMPY\x01\x00v\x00{'descr'", ReadError, "could not be read by (the NumPy reader|NumPy)"),
        (
            "cut.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\nproperty float x\nend_header\n",
            ReadError,
            "announces 1000000000 rows of element 'vertex', which takes at least 1000000000 bytes, but has 0 bytes",
        ),
        ("cut.pcd", b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\n", ReadError, "has no complete .pcd header"),
        ("cut.las", b"LASF" + struct.pack("<I", 7), ReadError, "could not be read by laspy"),
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
    with pytest.raises(ReadError, match="Object arrays cannot be loaded"):
        tk.load(path)


@pytest.mark.parametrize(
    "text",
    [
        "1,5 -2,25 3,0\n4 5,5 6,125e1\n",
        "1,5;-2,25;3,0\n4;5,5;6,125e1;\n",
        "1,5; -2,25; 3,0\r\n4; 5,5; 6,125e1\r\n",
        "1,5, -2,25, 3,0\n4, 5,5, 6,125e1\n",
        "# x y z\nX;Y;Z\n1,5\t-2,25\t3,0\n4\t5,5\t6,125e1\n",
        "1.5,-2.25,3.0,a tree\n4,5.5,61.25,a house\n",
        "1.5, -2.25, 3.0\n4, 5.5, 61.25\n",
        "1.5;-2.25;3.0\n4;5.5;61.25\n",
        "x,y,z\n1.5,-2.25,3\n4,5.5,61.25\n",
    ],
)
def test_decimal_commas_and_separators_are_told_apart(text: str, tmp_path: Path) -> None:
    path = tmp_path / "cloud.csv"
    path.write_bytes(text.encode())
    np.testing.assert_array_equal(read_points(path)[0], [[1.5, -2.25, 3], [4, 5.5, 61.25]])


def test_integers_are_not_taken_for_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "pixels.csv"
    path.write_text("1,2,3\n4,5,6\n")
    np.testing.assert_array_equal(read_points(path)[0], [[1, 2, 3], [4, 5, 6]])
    path.write_text("10,20,30,255,0,128\n11,21,31,0,0,0\n")
    np.testing.assert_array_equal(read_points(path)[0], [[10, 20, 30], [11, 21, 31]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "0,5,0,25,0,125\n0,188817,0,412345,0,25\n",
            r"'0,188817,0,412345,0,25' may be 6 integers or 3 numbers with decimal commas",
        ),
        ("1,05,2,5,3,5\n", "may be 6 integers or 3 numbers with decimal commas"),
        ("1,234.5 2,345.5 3,456.5\n", "the commas may be decimal signs, thousands separators or column separators"),
        ("1,000,000 2,000,000 3,000,000\n", "the commas may be decimal signs, thousands separators"),
        ("1 2 3\n1,5 2.5 3,5\n", "the commas may be decimal signs"),
    ],
)
def test_ambiguous_commas_are_refused_with_what_to_do(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "cloud.csv"
    path.write_text(text)
    with pytest.raises(ReadError, match=message + r".*Write numbers with decimal points"):
        read_points(path)


def las_bytes(tmp_path: Path, n_points: int = 40) -> bytearray:
    laspy = pytest.importorskip("laspy")
    file = laspy.create(point_format=0, file_version="1.2")
    file.x = file.y = file.z = np.arange(n_points, dtype=float)
    file.write(tmp_path / "intact.las")
    return bytearray((tmp_path / "intact.las").read_bytes())


def damaged_headers(tmp_path: Path) -> dict[str, bytes]:
    """Files of a few kilobytes whose headers announce gigabytes."""
    las_points, las_records = las_bytes(tmp_path), las_bytes(tmp_path)
    las_points[107:111] = las_records[100:104] = (10**9).to_bytes(4, "little")
    array = io.BytesIO()
    np.lib.format.write_array_header_1_0(array, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 3)})
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("points.npy", array.getvalue() + bytes(100))
    pcd = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1000000000\nHEIGHT 1\nPOINTS 1000000000\n"
    )
    xyz = "".join(f"property float {axis}\n" for axis in "xyz")
    return {
        "points.las": bytes(las_points),
        "records.las": bytes(las_records),
        "cloud.npy": array.getvalue() + bytes(100),
        "cloud.npz": archive.getvalue(),
        "binary.pcd": f"{pcd}DATA binary\n".encode() + bytes(100),
        "packed.pcd": f"{pcd}DATA binary_compressed\n".encode() + struct.pack("<II", 92, 4 * 10**9) + bytes(92),
        "binary.ply": f"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\n{xyz}end_header\n".encode(),
        "text.ply": f"ply\nformat ascii 1.0\nelement vertex 1000000000\n{xyz}end_header\n0 0 0\n".encode(),
    }


def test_no_header_is_trusted_with_memory(tmp_path: Path) -> None:
    for name, content in damaged_headers(tmp_path).items():
        path = tmp_path / name
        path.write_bytes(content)
        tracemalloc.start()  # counts what is asked for, touched or not
        with pytest.raises(ReadError, match=f"{name} .*announces"):
            read_points(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 32 << 20, f"{name} of {len(content)} bytes takes {peak >> 20} MiB"


@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".npy", ".npz", ".ply", ".pcd", ".las"])
def test_damaged_files_end_in_a_read_error(suffix: str, tmp_path: Path) -> None:
    """Bits flipped, bytes cut out, ends cut off: a bug of a reader would come out as what it is."""
    path = tmp_path / f"cloud{suffix}"
    write(path, TABLE[:40])
    intact = path.read_bytes()
    rng = np.random.default_rng(0)
    refusals = []
    for _ in range(300):
        content = bytearray(intact)
        for at in rng.integers(0, len(content) if rng.random() < 0.5 else 200, size=int(rng.integers(1, 4))):
            content[at] = int(rng.integers(256))
        start = int(rng.integers(0, len(content)))
        if rng.random() < 0.5:
            del content[start : start + int(rng.integers(1, 2 * len(content)))]
        path.write_bytes(content)
        try:
            points, normals = read_points(path)
        except ReadError as error:
            refusals.append(str(error))
        else:
            assert points.shape[1] == 3
            assert normals is None or normals.shape[1] == 3
    assert len(refusals) > 60
    assert all(path.name in refusal for refusal in refusals)


def test_compressed_las_without_a_backend_names_what_to_install(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    if laspy.LazBackend.detect_available():
        pytest.skip("a backend for .laz is installed")
    content = las_bytes(tmp_path)
    content[104] |= 128  # the point format of compressed points
    (tmp_path / "cloud.laz").write_bytes(content)
    with pytest.raises(MissingDependencyError, match="pip install lazrs"):
        read_points(tmp_path / "cloud.laz")


def test_arrays_that_are_no_real_numbers_are_refused(tmp_path: Path) -> None:
    for values in (np.zeros((30, 3), complex), np.full((30, 3), "a")):
        np.save(tmp_path / "cloud.npy", values)
        with pytest.raises(ReadError, match=r"holds an array of .*; real numbers were expected"):
            read_points(tmp_path / "cloud.npy")


def test_missing_files_directories_and_names(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="does not exist"):
        tk.load(tmp_path / "nowhere.ply")
    with pytest.raises(ReadError, match=r"is a directory"):
        tk.load(tmp_path)
    with pytest.raises(InputError, match=r"adapter 'meshes' is not known. Known: mesh, points"):
        tk.load(__file__, adapter="meshes")
