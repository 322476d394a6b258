"""Damaged splat files, thousands per format: each is read or refused, quickly and in little memory.

Only the errors that mean a bad file count as refusals. A bug of a reader (TypeError, IndexError, ...) fails the test,
even where `load` wraps it in an AdapterError.
"""

from __future__ import annotations

import contextlib
import io
import shutil
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damage import mutate
from splat_writers import (
    WRITERS,
    join_spz_4,
    random_scene,
    sog_members,
    spz_streams,
    write_compressed_ply,
    write_ksplat,
    write_ply,
    write_splat,
    zip_members,
)

import topokit as tk
from topokit.adapters.splats.formats import ply
from topokit.errors import InputError, ReadError, UnknownFormatError

REFUSALS = (InputError, ReadError, UnknownFormatError)
resource: Any = pytest.importorskip("resource", reason="the memory of a process is measured as on Unix")
N_FILES = [150, pytest.param(2000, marks=pytest.mark.long)]  # mutated, of each format
SHAPED_EVERY = 50  # of the files that can be read, one in so many also goes through cleaning and sampling
SECONDS = 10.0  # of one core per format; about 1.5 are used
MEBIBYTES = 64  # of growth per format, where the files have kilobytes


def whole_files(write: Callable[[Path], None]) -> Callable[[Path], Callable[[np.random.Generator], bytes]]:
    """Mutations of the file as it lies on the disk."""

    def prepare(folder: Path) -> Callable[[np.random.Generator], bytes]:
        write(folder / "intact")
        content = (folder / "intact").read_bytes()
        return lambda rng: mutate(content, rng)

    return prepare


def gzipped_spz(version: int) -> Callable[[Path], Callable[[np.random.Generator], bytes]]:
    """Half of the mutations before compression, so that they get past the checksum."""

    def prepare(folder: Path) -> Callable[[np.random.Generator], bytes]:
        header, streams = spz_streams(random_scene(20), version, sh_degree=1)
        content = header + b"".join(streams)

        def gzip(body: bytes) -> bytes:
            packer = zlib.compressobj(1, wbits=31)
            return packer.compress(body) + packer.flush()

        return lambda rng: gzip(mutate(content, rng)) if rng.random() < 0.5 else mutate(gzip(content), rng)

    return prepare


def spz_4(folder: Path) -> Callable[[np.random.Generator], bytes]:
    header, streams = spz_streams(random_scene(20), 4, sh_degree=1)

    def next_file(rng: np.random.Generator) -> bytes:
        if rng.random() < 0.5:
            return mutate(join_spz_4(header, streams), rng)
        changed = list(streams)
        which = int(rng.integers(len(changed)))
        changed[which] = mutate(changed[which], rng)
        return join_spz_4(mutate(header, rng)[:16].ljust(16, b"\0") if rng.random() < 0.3 else header, changed)

    return next_file


def sog(folder: Path) -> Callable[[np.random.Generator], bytes]:
    """Half of the mutations inside the archive, where its checksums do not see them."""
    members = sog_members(random_scene(20))
    whole = zip_members(members)

    def next_file(rng: np.random.Generator) -> bytes:
        if rng.random() < 0.5:
            return mutate(whole, rng)
        name = list(members)[int(rng.integers(len(members)))]
        return zip_members({**members, name: mutate(members[name], rng)})

    return next_file


def scene_writer(write: Callable[..., None], **options: object) -> Callable[[Path], None]:
    return lambda path: write(path, random_scene(20), **options)


FORMATS: dict[str, tuple[str, Callable[[Path], Callable[[np.random.Generator], bytes]]]] = {
    "3dgs": ("f.ply", whole_files(scene_writer(write_ply))),
    "2dgs": ("f.ply", whole_files(scene_writer(write_ply, n_scales=2))),
    "3dgs-text": ("f.ply", whole_files(scene_writer(write_ply, style="ascii"))),
    "compressed": ("f.ply", whole_files(scene_writer(write_compressed_ply))),
    "splat": ("f.splat", whole_files(scene_writer(write_splat))),
    "spz-1": ("f.spz", gzipped_spz(1)),
    "spz-2": ("f.spz", gzipped_spz(2)),
    "spz-3": ("f.spz", gzipped_spz(3)),
    "spz-4": ("f.spz", spz_4),
    "sog": ("f.sog", sog),
    "ksplat-0": ("f.ksplat", whole_files(scene_writer(write_ksplat))),
    "ksplat-1": ("f.ksplat", whole_files(scene_writer(write_ksplat, level=1))),
}


def read_all(files: Iterator[bytes], path: Path) -> tuple[int, list[str]]:
    """The number of files that were read, and the messages about the others; any other error ends the test."""
    n_read = 0
    refusals = []
    for content in files:
        path.write_bytes(content)
        try:
            splats = tk.GaussianSplats.from_file(path)
            n_read += 1
            assert len(splats) < 100_000, "more splats than the file has bytes for"
            if n_read % SHAPED_EVERY == 0:
                tk.load(path, adapter="splats", n_samples=50, n_neighbors=8)
        except REFUSALS as error:
            refusals.append(str(error))
    return n_read, refusals


@pytest.mark.parametrize("n_files", N_FILES)
@pytest.mark.parametrize("format_name", FORMATS)
def test_damaged_files_end_in_a_topokit_error(format_name: str, n_files: int, tmp_path: Path) -> None:
    name, prepare = FORMATS[format_name]
    next_file = prepare(tmp_path)
    read_all((next_file(np.random.default_rng(i)) for i in range(50)), tmp_path / name)  # imports take memory too
    rng = np.random.default_rng(0)
    before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    n_read, refusals = read_all((next_file(rng) for _ in range(n_files)), tmp_path / name)
    assert len(refusals) > 0.05 * n_files, "the mutations do not reach what the reader checks"
    assert n_read > 0.01 * n_files, "the mutations leave nothing to read"
    assert min(map(len, refusals)) > 20, "an error should say what came and what was expected"
    assert time.process_time() - started < SECONDS
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024 < MEBIBYTES


@pytest.mark.parametrize("n_files", N_FILES)
def test_damaged_sog_folders_end_in_a_topokit_error(n_files: int, tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    WRITERS["sog-folder"][1](folder, random_scene(20))
    intact = {path.name: path.read_bytes() for path in folder.iterdir()}
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(n_files):
        victim = sorted(intact)[int(rng.integers(len(intact)))]
        (folder / victim).write_bytes(mutate(intact[victim], rng))
        try:
            tk.GaussianSplats.from_file(folder)
        except REFUSALS:
            refused += 1
        (folder / victim).write_bytes(intact[victim])
    assert refused > 0.05 * n_files
    for victim in intact:
        (folder / victim).unlink()
        with pytest.raises(ReadError, match=victim if victim != "meta.json" else "is a directory"):
            tk.GaussianSplats.from_file(folder)
        (folder / victim).write_bytes(intact[victim])
    shutil.rmtree(folder)


@pytest.mark.parametrize("suffix", [".ply", ".splat", ".spz", ".sog", ".ksplat"])
def test_noise_under_any_suffix_ends_in_a_topokit_error(suffix: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for size in (1, 2, 31, 32, 33, 4096, 6000):
        for start in (b"", b"ply\n", b"\x1f\x8b", b"NGSP", b"PK\x03\x04", b"\0\1\0\0", b'{"means":1,"quats":2}'):
            (tmp_path / f"noise{suffix}").write_bytes((start + rng.bytes(size))[: max(size, 1)])
            with contextlib.suppress(*REFUSALS):
                tk.load(tmp_path / f"noise{suffix}", n_samples=50, n_neighbors=8)


def test_meta_that_is_valid_json_but_nonsense(tmp_path: Path) -> None:
    members = sog_members(random_scene(20))
    for meta in (b"[]", b"{}", b"1", b'{"version":2}', b'{"version":2,"count":-1}', b"[" * 10_000, b'{"version":NaN}'):
        (tmp_path / "scene.sog").write_bytes(zip_members({**members, "meta.json": meta}))
        with pytest.raises(ReadError, match=r"meta\.json|JSON"):
            tk.GaussianSplats.from_file(tmp_path / "scene.sog")
    for name in ("../quats.webp", "/etc/passwd", "", "a\\b"):
        nonsense = members["meta.json"].replace(b'"quats.webp"', b'"' + name.replace("\\", "\\\\").encode() + b'"')
        (tmp_path / "scene.sog").write_bytes(zip_members({**members, "meta.json": nonsense}))
        with pytest.raises(ReadError, match="plain file name"):
            tk.GaussianSplats.from_file(tmp_path / "scene.sog")


def test_an_image_far_larger_than_its_splats_is_refused(tmp_path: Path) -> None:
    members = sog_members(random_scene(20))
    claimed = bytearray(members["quats.webp"])
    claimed[21:25] = (16383 | 1023 << 14).to_bytes(4, "little")  # 64 MiB once they are unpacked
    (tmp_path / "scene.sog").write_bytes(zip_members({**members, "quats.webp": bytes(claimed)}))
    with pytest.raises(ReadError, match="has 16384 × 1024 pixels, which do not fit 20 splats"):
        tk.GaussianSplats.from_file(tmp_path / "scene.sog")


def test_an_archive_bomb_is_refused(tmp_path: Path) -> None:
    members = sog_members(random_scene(20))
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content if name != "meta.json" else content + b" " * (8 << 20))
    (tmp_path / "bomb.sog").write_bytes(target.getvalue())
    with pytest.raises(ReadError, match=r"its meta\.json has \d+ bytes; at most"):
        tk.GaussianSplats.from_file(tmp_path / "bomb.sog")


@pytest.mark.parametrize(
    "bug", [TypeError, AttributeError, AssertionError, IndexError, KeyError, RuntimeError, MemoryError]
)
def test_a_bug_of_a_reader_is_not_called_a_damaged_file(
    bug: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(path: Path) -> None:
        raise bug("a bug")

    monkeypatch.setattr(ply, "ply_elements", broken)
    write_ply(tmp_path / "scene.ply", random_scene(20))
    with pytest.raises(bug, match="a bug"):
        read_all(iter([(tmp_path / "scene.ply").read_bytes()]), tmp_path / "scene.ply")
