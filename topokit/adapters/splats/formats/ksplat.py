""".ksplat (mkkellogg): sections of buckets, three levels of compression."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from topokit.adapters.splats.formats.splat_table import CONVERTER, Floats, SplatTable
from topokit.errors import ReadError
from topokit.inputs.size_limits import require_bytes

_HEADER, _SECTION = 4096, 1024
_SH_VALUES = (0, 9, 24, 45)  # by degree
_SH_BYTES = (4, 2, 1)  # by level


class _Section(NamedTuple):
    n_splats: int
    capacity: int
    bucket_size: int
    n_buckets: int
    block_size: float
    bucket_bytes: int
    scale_range: int
    n_full: int
    n_partial: int
    sh_degree: int


_SECTION_HEADER = struct.Struct("<IIIIfH2xI4xIIH")


def read_ksplat(path: Path) -> SplatTable:
    """Splats of a .ksplat file: linear scales, rotations wxyz; at levels 1 and 2 half floats and bucket offsets.

    Raises:
        ReadError: if version, level, section or bucket counts do not agree with the file's size.

    Reference:
        https://github.com/mkkellogg/GaussianSplats3D
    """
    size = path.stat().st_size
    require_bytes(path, "a .ksplat header", _HEADER, size)
    content = path.read_bytes()
    major, minor, n_sections, count, level = struct.unpack_from("<BB2xI8xIH", content)
    if major != 0 or minor < 1 or level > 2:
        raise ReadError(
            f"{path} is .ksplat {major}.{minor} of level {level}; 0.1 and levels 0 to 2 are known. {CONVERTER}"
        )
    at = _HEADER + n_sections * _SECTION
    require_bytes(path, f"{n_sections} section headers", at, size)
    tables = []
    for index in range(n_sections):
        section = _Section(*_SECTION_HEADER.unpack_from(content, _HEADER + index * _SECTION))
        table, at = _read_section(path, content, section, level, at)
        tables.append(table)
    total = sum(len(table.means) for table in tables)
    if total == 0 or total != count:
        raise ReadError(f"{path} announces {count} splats; its {n_sections} sections hold {total}.")
    return SplatTable(*(np.concatenate(column) for column in zip(*tables, strict=True)))


def _read_section(path: Path, content: bytes, section: _Section, level: int, at: int) -> tuple[SplatTable, int]:
    """Splats of the section whose data begin at byte `at`, and where the next section's begin."""
    if section.sh_degree >= len(_SH_VALUES) or section.n_splats > section.capacity:
        raise ReadError(
            f"{path}: a section gives {section.n_splats} splats of {section.capacity} and harmonics of degree "
            f"{section.sh_degree}; the file is damaged."
        )
    row = _row(level, section.sh_degree)
    buckets = 4 * section.n_partial + section.bucket_bytes * section.n_buckets
    end = at + buckets + row.itemsize * section.capacity
    require_bytes(path, f"a section of {section.capacity} splats", end, len(content))
    rows = np.frombuffer(content, dtype=row, count=section.n_splats, offset=at + buckets)
    means = rows["mean"].astype(np.float32)
    if level > 0:
        means = _in_buckets(path, section, means, content[at : at + buckets])
    scales = rows["scale"].astype(np.float32)
    if (scales < 0).any():
        raise ReadError(f"{path}: {int((scales < 0).any(axis=1).sum())} splats have negative scales; it is damaged.")
    opacities = rows["color"][:, 3].astype(np.float32) / np.float32(255)
    return SplatTable(means, scales, rows["rotation"].astype(np.float32), opacities), end


def _row(level: int, sh_degree: int) -> np.dtype[np.void]:
    mean, real = ("<f4", "<f4") if level == 0 else ("<u2", "<f2")
    harmonics = _SH_VALUES[sh_degree] * _SH_BYTES[level]
    fields = [("mean", mean, 3), ("scale", real, 3), ("rotation", real, 4), ("color", "u1", 4)]
    return np.dtype([*fields, ("harmonics", "u1", harmonics)])


def _in_buckets(path: Path, section: _Section, steps: Floats, buckets: bytes) -> Floats:
    """Positions from 16-bit steps around the center of each splat's bucket."""
    sizes = np.frombuffer(buckets, dtype="<u4", count=section.n_partial)
    if section.bucket_bytes < 12 or section.n_full + section.n_partial > section.n_buckets:
        raise ReadError(f"{path}: the buckets of a section do not add up; the file is damaged.")
    in_full = section.n_full * section.bucket_size
    splat = np.arange(section.n_splats, dtype=np.int64)
    partial = np.searchsorted(in_full + np.cumsum(sizes, dtype=np.int64), splat, side="right")
    bucket = np.where(splat < in_full, splat // max(1, section.bucket_size), section.n_full + partial)
    if bucket.max(initial=0) >= section.n_full + section.n_partial:
        raise ReadError(
            f"{path}: {section.n_splats} splats do not fit into their section's buckets; the file is damaged."
        )
    padding = ("padding", "u1", section.bucket_bytes - 12)
    centers = np.frombuffer(buckets, dtype=[("center", "<f4", 3), padding], offset=4 * section.n_partial)["center"]
    half = section.scale_range or 32767
    means: Floats = (steps - half) * np.float32(section.block_size / 2 / half) + centers[bucket]
    return means
