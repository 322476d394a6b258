"""gzip files, bytes, file objects and ~: whatever comes in is read as the file that it would be."""

from __future__ import annotations

import gzip
import io
import tempfile
from pathlib import Path

import numpy as np
import pytest

import topokit as tk
from topokit.errors import InputError, ReadError, UnknownFormatError
from topokit.testing import sphere_samples

DATA = Path(__file__).resolve().parents[1] / "data"
TORUS, SPHERE, BOWL = "torus.stl", "sphere.ply", "bowl.obj"


def euler(shape: tk.Shape) -> int | None:
    return shape.report().euler


@pytest.mark.parametrize("name", [TORUS, SPHERE, BOWL])
def test_packed_files_are_read_as_what_they_hold(name: str, tmp_path: Path) -> None:
    packed = tmp_path / f"{name}.gz"
    packed.write_bytes(gzip.compress((DATA / name).read_bytes()))
    before = set(Path(tempfile.gettempdir()).glob("topokit-*"))
    for shape in (tk.load(packed), tk.from_mesh(packed)):
        assert (euler(shape), shape.name) == (euler(tk.load(DATA / name)), packed.name)
    assert set(Path(tempfile.gettempdir()).glob("topokit-*")) <= before
    assert [row["euler"] for row in tk.survey(tmp_path)] == [euler(tk.load(DATA / name))]


def test_packed_clouds_volumes_and_splats(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.xyz.gz", sphere_samples(100).points.numpy())
    assert tk.load(tmp_path / "a.xyz.gz").samples.n_points == 100
    assert tk.from_points(tmp_path / "a.xyz.gz").name == "a.xyz.gz"
    ring = np.ones((3, 3, 1), dtype=np.uint8)
    ring[1, 1] = 0
    with gzip.open(tmp_path / "b.npy.gz", "wb") as file:
        np.save(file, ring)
    assert tk.load(tmp_path / "b.npy.gz").genus() == tk.from_voxels(tmp_path / "b.npy.gz").genus() == 1


def test_errors_name_the_packed_file(tmp_path: Path) -> None:
    packed = tmp_path / "broken.stl.gz"
    packed.write_bytes(gzip.compress((DATA / "truncated.stl").read_bytes()))
    with pytest.raises(ReadError) as caught:
        tk.load(packed)
    assert str(caught.value).startswith(str(packed))
    packed.write_bytes(packed.read_bytes()[:-50])
    with pytest.raises(ReadError, match="could not be read by gzip"):
        tk.from_mesh(packed)


@pytest.mark.parametrize("name", ["cloud.ply", "cloud.npy", "archive.npz"])
@pytest.mark.parametrize("n_bytes", [8, 200])
def test_a_truncated_packed_file_is_called_damaged(name: str, n_bytes: int, tmp_path: Path) -> None:
    packed = gzip.compress(np.random.default_rng(0).bytes(2000))
    (tmp_path / f"{name}.gz").write_bytes(packed[:n_bytes])
    with pytest.raises(ReadError, match=rf"{name}\.gz could not be read by gzip .*truncated"):
        tk.load(tmp_path / f"{name}.gz")


@pytest.mark.parametrize(("suffix", "expected"), [(".ply", "b'ply'"), (".npy", "NUMPY"), (".npz", "PK")])
def test_another_file_under_a_suffix_of_several_adapters(suffix: str, expected: str, tmp_path: Path) -> None:
    text = "".join(f"0.25 0.5 1\n0.25 0.5 {number}\n" for number in range(2, 42))
    (tmp_path / f"a{suffix}").write_text(text)
    (tmp_path / f"a{suffix}.gz").write_bytes(gzip.compress(text.encode()))
    for name in (f"a{suffix}", f"a{suffix}.gz"):
        with pytest.raises(ReadError, match=rf"a\{suffix}(\.gz)? begins with b'0\.25 0\.5 1.*{expected}"):
            tk.load(tmp_path / name)
    assert tk.load(tmp_path / f"a{suffix}", format="xyz", n_neighbors=3).samples.n_points == 41


def test_a_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("topokit.inputs.unpacking.FREE_OF_MASKS", 1 << 20)
    (tmp_path / "bomb.xyz.gz").write_bytes(gzip.compress(bytes(20 << 20)))
    with pytest.raises(ReadError, match="decompression bomb"):
        tk.load(tmp_path / "bomb.xyz.gz")


def test_bytes_and_file_objects() -> None:
    content = (DATA / TORUS).read_bytes()
    for source in (content, bytearray(content), memoryview(content), io.BytesIO(content)):
        assert euler(tk.load(source, format="stl")) == 0
        with pytest.raises(UnknownFormatError, match=r"Or pass the suffix that such files have: format='stl'\."):
            tk.load(source if isinstance(source, bytes) else content)
    assert euler(tk.load((DATA / SPHERE).read_bytes())) == 2  # known by its content
    with (DATA / TORUS).open("rb") as file:
        shape = tk.load(file)
    assert (euler(shape), shape.name) == (0, TORUS)
    text = "\n".join(f"{x} {y} {z}" for x, y, z in sphere_samples(50).points.tolist())
    assert tk.load(io.StringIO(text), format=".xyz").samples.n_points == 50
    assert euler(tk.load(gzip.compress(content), format="stl.gz")) == 0


def test_a_file_under_a_wrong_name(tmp_path: Path) -> None:
    (tmp_path / "torus.dat").write_bytes((DATA / TORUS).read_bytes())
    assert euler(tk.load(tmp_path / "torus.dat", format="stl")) == 0
    with pytest.raises(InputError, match="is that of a file"):
        tk.load(tmp_path, format="stl")


@pytest.mark.parametrize(
    ("source", "format", "message"),
    [
        (b"", "stl", "holds no bytes"),
        (io.BytesIO(), "stl", "holds no bytes"),
        (b"x", "../stl", "format is '../stl'; expected the suffix"),
        (b"x", ".", "expected the suffix"),
    ],
)
def test_what_cannot_be_kept_is_explained(source: object, format: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        tk.load(source, format=format)


def test_read_must_give_bytes() -> None:
    class Odd:
        def read(self, size: int) -> int:
            return size

        def close(self) -> None:
            """Nothing to close."""

    with pytest.raises(InputError, match=r"read\(\) of Odd gave int; bytes were expected"):
        tk.load(Odd(), format="stl")


def test_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path))
    (tmp_path / TORUS).write_bytes((DATA / TORUS).read_bytes())
    assert euler(tk.load(f"~/{TORUS}")) == euler(tk.from_mesh(f"~/{TORUS}")) == 0
