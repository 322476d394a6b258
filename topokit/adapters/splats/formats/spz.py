""".spz 1 to 4 (Niantic): quantized attributes one after the other, gzipped as a whole or Zstandard per attribute."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.splats.formats.splat_table import CONVERTER, Floats, SplatTable, with_largest
from topokit.errors import MissingDependencyError, ReadError
from topokit.inputs.size_limits import require_bytes, require_expansion

Bytes = NDArray[np.uint8]
_MAGIC = b"NGSP"
HEADER = struct.Struct("<4sIIBBBB")
_V4_HEADER = struct.Struct("<4sIIBBBBI12x")
_ENTRY = struct.Struct("<QQ")
_SH_BYTES = (0, 9, 24, 45, 72)  # by degree
_STEP = 1 << 20


class _Layout(NamedTuple):
    version: int
    n_splats: int
    sh_degree: int
    fractional_bits: int

    def sizes(self) -> tuple[int, ...]:
        """Bytes of positions, alphas, colors, scales, rotations, harmonics."""
        position = 6 if self.version == 1 else 9
        rotation = 4 if self.version >= 3 else 3
        return tuple(self.n_splats * each for each in (position, 1, 3, 3, rotation, _SH_BYTES[self.sh_degree]))


def read_spz(path: Path) -> SplatTable:
    """Splats of an .spz file, whichever of the four versions; also the rare file that was never gzipped.

    Raises:
        ReadError: if the file is truncated, damaged (checksums are verified) or of an unknown version.
        MissingDependencyError: for version 4 without `zstandard`.

    Reference:
        https://github.com/nianticlabs/spz
    """
    content = path.read_bytes()
    if content.startswith(_MAGIC) and _version(content) >= 4:
        return _from_streams(path, content)
    if content.startswith(_MAGIC):
        header = layout_of(path, content)
        needed = HEADER.size + sum(header.sizes())
        require_bytes(path, f"{header.n_splats} splats", needed, len(content))
        return _decode(header, _cut(content[HEADER.size : needed], header))
    return _from_gzip(path, content)


def _version(content: bytes) -> int:
    return int.from_bytes(content[4:8], "little")


def layout_of(path: Path, content: bytes) -> _Layout:
    if len(content) < HEADER.size or not content.startswith(_MAGIC):
        raise ReadError(f"{path} is no .spz file: it does not begin with an NGSP header of {HEADER.size} bytes.")
    _, version, count, degree, bits, _, _ = HEADER.unpack_from(content)
    if not 1 <= version <= 4:
        raise ReadError(f"{path} is .spz version {version}; versions 1 to 4 are known. {CONVERTER}")
    if count == 0 or degree >= len(_SH_BYTES) or bits > 23:
        raise ReadError(
            f"{path}: the .spz header gives {count} splats, harmonics of degree {degree} and {bits} fractional bits; "
            "expected at least 1, at most 4 and at most 23. The file is damaged."
        )
    return _Layout(version, count, degree, bits)


def _from_gzip(path: Path, content: bytes) -> SplatTable:
    unzip = zlib.decompressobj(wbits=31)
    header = layout_of(path, unzip.decompress(content, HEADER.size))
    sizes = header.sizes()
    require_expansion(path, sum(sizes), len(content))
    wanted = sum(sizes[:-1])
    body = unzip.decompress(unzip.unconsumed_tail, wanted)
    require_bytes(path, f"{header.n_splats} splats", wanted, len(body))
    _drain(path, unzip, sizes[-1])
    return _decode(header, _cut(body, header))


def _drain(path: Path, unzip: zlib._Decompress, harmonics: int) -> None:
    """Decompress to the end without keeping the data, so that the checksum is verified."""
    rest = 0
    while not unzip.eof:
        step = unzip.decompress(unzip.unconsumed_tail, _STEP)
        rest += len(step)
        if not step and not unzip.eof:
            raise ReadError(f"{path} ends in the middle of its gzip stream: it is truncated.")
        if rest > harmonics + _STEP:  # extensions are a few hundred bytes
            raise ReadError(f"{path} expands to more than its header announces; it is damaged.")
    require_bytes(path, "spherical harmonics", harmonics, rest)


def _from_streams(path: Path, content: bytes) -> SplatTable:
    if len(content) < _V4_HEADER.size:
        raise ReadError(f"{path} has {len(content)} bytes, too few for the 32-byte header of .spz version 4.")
    header = layout_of(path, content)
    _, _, _, _, _, _, n_streams, at = _V4_HEADER.unpack_from(content)
    sizes = [size for size in header.sizes() if size]
    if n_streams != len(sizes) or at < _V4_HEADER.size:
        raise ReadError(f"{path} announces {n_streams} streams at byte {at}; {len(sizes)} were expected from byte 32.")
    require_bytes(path, f"a table of {n_streams} streams", at + n_streams * _ENTRY.size, len(content))
    table = [_ENTRY.unpack_from(content, at + _ENTRY.size * stream) for stream in range(n_streams)]
    starts = np.cumsum([0, *(packed for packed, _ in table)], dtype=np.uint64) + (at + n_streams * _ENTRY.size)
    require_bytes(path, "compressed streams", sum(packed for packed, _ in table), len(content) - int(starts[0]))
    if [unpacked for _, unpacked in table] != sizes:
        raise ReadError(f"{path}: the sizes of its streams do not fit {header.n_splats} splats; it is damaged.")
    require_expansion(path, sum(sizes), len(content))
    streams = [
        _unpack(path, content[int(start) : int(start) + packed], unpacked)
        for start, (packed, unpacked) in zip(starts, table[:5], strict=False)
    ]
    return _decode(header, streams)


def _unpack(path: Path, packed: bytes, size: int) -> Bytes:
    try:
        import zstandard
    except ImportError as error:
        raise MissingDependencyError(
            'Reading .spz version 4 needs zstandard: pip install "topokit[splats]".'
        ) from error
    try:
        announced = zstandard.get_frame_parameters(packed).content_size
        if announced not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ReadError(f"{path}: a stream expands to {announced} bytes instead of {size}; the file is damaged.")
        body = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ReadError(f"{path}: a Zstandard stream is damaged or truncated ({error}).") from error
    require_bytes(path, "a Zstandard stream", size, len(body))
    return np.frombuffer(body, dtype=np.uint8)


def _cut(body: bytes, header: _Layout) -> list[Bytes]:
    ends = np.cumsum(header.sizes()[:-1])
    return np.split(np.frombuffer(body, dtype=np.uint8)[: ends[-1]], ends[:-1])


def _decode(header: _Layout, streams: list[Bytes]) -> SplatTable:
    """Splats in the axes of 3DGS .ply (y down, z forward): .spz has them y up, z back, half a turn around x away."""
    positions, alphas, _, scales, rotations = streams
    quaternions = _smallest_three(rotations) if header.version >= 3 else _first_three(rotations)
    return SplatTable(
        _positions(header, positions) * np.array([1, -1, -1], dtype=np.float32),
        np.exp(scales.reshape(-1, 3).astype(np.float32) / np.float32(16) - 10),
        quaternions * np.array([1, 1, -1, -1], dtype=np.float32),
        alphas.astype(np.float32) / np.float32(255),
    )


def _positions(header: _Layout, packed: Bytes) -> Floats:
    if header.version == 1:
        return packed.view("<f2").reshape(-1, 3).astype(np.float32)
    low = packed.reshape(-1, 3, 3).astype(np.int32)
    fixed = (low[..., 0] | low[..., 1] << 8 | low[..., 2] << 16) << 8 >> 8  # the shifts carry the sign along
    return fixed.astype(np.float32) / np.float32(1 << header.fractional_bits)


def _first_three(packed: Bytes) -> Floats:
    """x, y, z as u/127.5 − 1; w is what is left of 1."""
    vector = packed.reshape(-1, 3).astype(np.float32) / np.float32(127.5) - 1
    return with_largest(np.zeros(len(vector), dtype=np.int64), vector)


def _smallest_three(packed: Bytes) -> Floats:
    """Top two bits: which of x, y, z, w is left out; then sign and nine bits each, first component highest."""
    bits = packed.view("<u4")
    fields = np.stack([(bits >> shift) & 1023 for shift in (20, 10, 0)], axis=1)
    size = (fields & 511).astype(np.float32) * np.float32(np.sqrt(0.5) / 511)
    return with_largest(bits >> 30, np.where(fields > 511, -size, size))[:, [3, 0, 1, 2]]
