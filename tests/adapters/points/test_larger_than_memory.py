"""Clouds read block by block: the same samples from any blocks, formats and workers, and what is said about them."""

from __future__ import annotations

import gzip
import itertools
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import topokit as tk
from topokit.adapters.points import adapter, larger_than_memory
from topokit.adapters.points.entry import FORMATS
from topokit.adapters.points.stored_clouds import Block, Cloud, MappedCloud, StoredCloud
from topokit.adapters.points.text import layout_of, read_rows, read_table
from topokit.core.cloud.sampling.larger_than_memory import reduced
from topokit.core.cloud.sampling.one_point_per_cell import Cells, joined
from topokit.errors import InputError, ReadError
from topokit.inputs.formats import stored_in
from topokit.inputs.ply import write_ply
from topokit.testing import torus_samples

Floats = NDArray[np.float64]

SAMPLES = torus_samples(20_000)
POINTS: Floats = np.round(SAMPLES.points.double().numpy(), 6)
assert SAMPLES.normals is not None
NORMALS: Floats = SAMPLES.normals.double().numpy()
SUFFIXES = (".npy", ".ply", "ascii.ply", ".xyz", ".csv", ".las", ".laz", ".parquet")
FEW_CELLS = 3000


@pytest.fixture(autouse=True)
def few_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(larger_than_memory, "MOST_CELLS", FEW_CELLS)


def write(path: Path, points: Floats, normals: Floats | None = None) -> Path:
    table = points if normals is None else np.concatenate((points, normals), axis=1)
    names = ("x", "y", "z", "nx", "ny", "nz")[: table.shape[1]]
    if path.suffix == ".npy":
        np.save(path, table)
    elif path.name.endswith("ascii.ply"):
        header = "".join(f"property double {name}\n" for name in names)
        rows = "\n".join(" ".join(map(repr, row)) for row in table.tolist())
        path.write_text(f"ply\nformat ascii 1.0\nelement vertex {len(table)}\n{header}end_header\n{rows}\n")
    elif path.suffix == ".ply":
        write_ply(path, vertex=np.rec.fromarrays(list(table.T), names=",".join(names)))
    elif path.suffix in (".las", ".laz"):
        laspy = pytest.importorskip("laspy")
        file = laspy.create(point_format=0, file_version="1.2")
        file.header.scales = [1e-6] * 3
        file.x, file.y, file.z = points.T
        file.write(path)
    elif path.suffix == ".parquet":
        arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
        parquet.write_table(arrow.table(dict(zip(names, table.T, strict=True))), path, row_group_size=7001)
    else:
        separator = "," if path.suffix == ".csv" else " "
        path.write_text(
            separator.join(names) + "\n" + "\n".join(separator.join(map(repr, row)) for row in table.tolist())
        )
    return path


def expected(points: Floats, normals: Floats | None = None) -> tk.Shape:
    left = reduced(joined([Cells.of(points, normals)], FEW_CELLS))
    return tk.from_points(left.points, left.normals)


def assert_same(one: tk.Shape, other: tk.Shape) -> None:
    assert torch.equal(one.samples.points, other.samples.points)
    assert (one.samples.normals is None) == (other.samples.normals is None)
    if one.samples.normals is not None and other.samples.normals is not None:
        assert torch.equal(one.samples.normals, other.samples.normals)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("with_normals", [False, True])
def test_every_format_gives_the_same_samples(suffix: str, with_normals: bool, tmp_path: Path) -> None:
    normals = NORMALS if with_normals and "la" not in suffix else None
    path = write(tmp_path / f"cloud{suffix}", POINTS, normals)
    in_memory = tk.from_points(path).samples  # small: read as a whole
    np.testing.assert_allclose(in_memory.points.numpy(), POINTS, atol=1e-9)
    wanted = expected(in_memory.points.numpy(), normals)
    assert 500 < wanted.samples.n_points < FEW_CELLS
    for block_points in (1234, 30_000):
        found = tk.from_points(path, block_points=block_points)
        assert_same(found, wanted)
    assert "of 20000 points" in found.notes[0]
    assert found.name == path.name


@settings(max_examples=15, deadline=None)
@given(st.integers(100, 40_000), st.integers(0, 2**32), st.sampled_from([".npy", ".xyz"]))
def test_any_blocks_give_the_same_samples(
    tmp_path_factory: pytest.TempPathFactory, block_points: int, seed: int, suffix: str
) -> None:
    path = tmp_path_factory.mktemp("blocks") / f"cloud{suffix}"
    rng = np.random.default_rng(seed)
    points = POINTS[rng.permutation(len(POINTS))[:5000]]
    points[::101] = np.nan
    points[7], points[8] = (1e9, 0, 0), (-1e30, 5, 1)  # far off: no box holds them and cells of any use
    found = tk.from_points(write(path, points), block_points=block_points)
    assert_same(found, expected(points[np.isfinite(points).all(1)]))
    assert f"{len(points[::101])} of 5000 points are NaN" in found.notes[0]


def test_a_reduced_cloud_has_the_answer_of_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(larger_than_memory, "MOST_CELLS", 20_000)
    rng = np.random.default_rng(0)
    points = torus_samples(200_000).points.double().numpy()
    points = points + 2e-3 * rng.normal(size=points.shape)
    points[::100] = rng.random((2000, 3)) * 3 - 1.5  # haze
    report = tk.from_points(write(tmp_path / "scan.npy", points), block_points=30_000).report()
    assert (report.euler, report.genus, report.components, report.verdict) == (0, 1, 1, "likely")
    assert any("of 200000 points were kept, at most one in each cell" in reason for reason in report.reasons)
    assert any("too few others around them" in reason for reason in report.reasons)


def test_large_files_and_memory_maps_are_read_by_blocks_by_themselves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "cloud.npy", POINTS)
    assert tk.from_points(path).samples.n_points == len(POINTS)
    monkeypatch.setattr(larger_than_memory, "MOST_IN_MEMORY", 10_000)
    wanted = expected(POINTS)
    assert_same(tk.from_points(path), wanted)
    assert_same(tk.load(path), wanted)
    assert_same(tk.from_points(np.load(path, mmap_mode="r")), wanted)
    assert tk.from_points(np.load(path, mmap_mode="r")[5:]).samples.n_points == len(POINTS) - 5
    assert tk.from_points(POINTS).samples.n_points == len(POINTS)


def test_useless_normals_are_noticed(tmp_path: Path) -> None:
    normals = NORMALS.copy()
    normals[::200] = np.nan
    keeps = np.isfinite(normals).all(1)
    found = tk.from_points(write(tmp_path / "few.npy", POINTS, normals), block_points=999)
    assert_same(found, expected(POINTS[keeps], normals[keeps]))
    assert "100 of 20000 normals are zero or not finite; their points were dropped." in found.notes
    normals[::20] = 0
    found = tk.from_points(write(tmp_path / "many.npy", POINTS, normals), block_points=999)
    assert_same(found, expected(POINTS))
    assert any("all normals were ignored" in note for note in found.notes)
    colors = np.random.default_rng(0).integers(0, 255, POINTS.shape)
    assert_same(tk.from_points(write(tmp_path / "colors.npy", POINTS, colors), block_points=999), expected(POINTS))
    assert_same(tk.from_points(write(tmp_path / "colors.xyz", POINTS, colors), block_points=999), expected(POINTS))


def test_clouds_without_valid_points_are_refused(tmp_path: Path) -> None:
    points = POINTS.copy()
    points[: len(points) * 3 // 4] = np.nan
    with pytest.raises(InputError, match=r"15000 of 20000 points are NaN.*More than half"):
        tk.from_points(write(tmp_path / "lost.npy", points), block_points=999)
    with pytest.raises(ReadError, match="holds no points"):
        tk.from_points(write(tmp_path / "none.npy", POINTS[:0]), block_points=999)


@pytest.mark.parametrize("suffix", [".npy", ".laz", ".parquet"])
def test_workers_refuse_clouds_without_points(suffix: str, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    path = write(tmp_path / f"none{suffix}", POINTS[:0])
    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
        pytest.raises(ReadError, match="holds no points"),
    ):
        tk.from_points(path, client=client)


def test_what_cannot_be_read_by_blocks_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "cloud.npy", POINTS)
    with pytest.raises(InputError, match="block_points must be at least 1"):
        tk.from_points(path, block_points=0)
    with pytest.raises(InputError, match="normals and lengths cannot be given"):
        tk.from_points(path, NORMALS, block_points=999)
    with pytest.raises(InputError, match="this Tensor can be used only as a whole"):
        tk.from_points(torch.from_numpy(POINTS), block_points=999)
    np.savez(tmp_path / "cloud.npz", points=POINTS)
    packed = tmp_path / "cloud.npy.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    for other in (tmp_path / "cloud.npz", packed):
        with pytest.raises(InputError, match="can be used only as a whole"):
            tk.from_points(other, block_points=999)
        assert tk.from_points(other).samples.n_points == len(POINTS)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_truncated_files_end_in_a_read_error(suffix: str, tmp_path: Path) -> None:
    path = write(tmp_path / f"cloud{suffix}", POINTS)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3] + (b"" if suffix not in (".xyz", ".csv") else b"\n0 nothing 1\n"))
    with pytest.raises(ReadError):
        tk.from_points(path, block_points=999)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from(["1,5 2 3", "4;5;6", "# 7 8 9", "", "7 8 9 # ten", " 1e3 .5 -2"])), st.data())
def test_blocks_of_bytes_are_rows_of_text(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str], data: st.DataObject
) -> None:
    """Whatever line ends there are, a row belongs to the block in which its line begins."""
    end = data.draw(st.sampled_from(["\n", "\r\n", "\r"]))
    path = tmp_path_factory.mktemp("text") / "rows.txt"
    path.write_bytes(b"\xef\xbb\xbf" * data.draw(st.booleans()) + end.join(["a header", "0,5 1 2", *lines]).encode())
    layout, size = layout_of(path), path.stat().st_size
    cuts = sorted(data.draw(st.lists(st.integers(layout.start, size))))
    edges = [layout.start, *cuts, size]
    parts = [read_rows(path, layout, block) for block in itertools.pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(parts), read_table(path))
    assert len(read_table(path)) == 1 + sum(bool(line.partition("#")[0].strip()) for line in lines)


def test_ply_with_more_than_vertices_is_read_where_that_is_possible(tmp_path: Path) -> None:
    path = tmp_path / "both.ply"
    records = np.rec.fromarrays(list(POINTS.T), names="x,y,z")
    write_ply(path, camera=records[:5], vertex=records, other=records[:3])
    assert_same(tk.from_points(path, block_points=999), expected(POINTS))
    content = path.read_bytes().replace(b"binary_little_endian", b"ascii")[:300]
    (tmp_path / "ascii.ply").write_bytes(content.partition(b"end_header")[0] + b"end_header\n" + b"0 0 0\n" * 20_008)
    assert stored_in(FORMATS, tmp_path / "ascii.ply") is None


class DeadlyOnce(MappedCloud):
    """A cloud whose first reading of one block kills the process that reads it."""

    mark: Path

    def read(self, block: Block, most_points: int) -> Iterator[Cloud]:
        """See `StoredCloud`."""
        if block[0] >= 9000 and not self.mark.exists():
            self.mark.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)
        yield from super().read(block, most_points)


@pytest.mark.long  # workers take seconds to start
@pytest.mark.parametrize("suffix", [".npy", ".laz", ".csv", ".parquet"])
def test_workers_keep_what_one_process_keeps(dask_client: Any, suffix: str, tmp_path: Path) -> None:
    path = write(tmp_path / f"cloud{suffix}", POINTS)
    alone = tk.from_points(path, block_points=700)
    found = tk.from_points(path, block_points=500, client=dask_client)
    assert_same(found, alone)
    assert found.notes == alone.notes


@pytest.mark.long
def test_a_worker_that_dies_costs_a_retry(dask_client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "cloud.npy", POINTS)
    deadly = DeadlyOnce(np.load(path, mmap_mode="r"))
    deadly.mark = tmp_path / "killed"
    monkeypatch.setattr(larger_than_memory, "stored_in", lambda *_: deadly)
    assert_same(tk.from_points(path, block_points=999, client=dask_client), expected(POINTS))
    assert int(deadly.mark.read_text()) != os.getpid()


@pytest.mark.long
def test_a_survey_gives_large_clouds_to_all_workers(
    dask_client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 2000 points one worker makes the report; of many all workers read, and this process makes it."""
    write(tmp_path / "small.npy", POINTS[:2000])
    write(tmp_path / "large.npy", POINTS)
    monkeypatch.setattr(larger_than_memory, "MOST_IN_MEMORY", 10_000)
    read_by: list[tuple[str, Any]] = []

    def spy(cloud: StoredCloud, block_points: int | None, client: Any) -> Any:
        read_by.append((cloud.path.name, client))
        return larger_than_memory.reduced_samples(cloud, block_points, client)

    monkeypatch.setattr(adapter, "reduced_samples", spy)
    rows = {row["file"].rpartition("/")[2]: row for row in tk.survey(tmp_path, client=dask_client).rows}
    assert rows["large.npy"]["genus"] == rows["small.npy"]["genus"] == 1
    assert read_by == [("large.npy", dask_client)]
