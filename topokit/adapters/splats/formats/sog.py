""".sog version 2 (PlayCanvas): quantized attributes as lossless WebP images and a meta.json, zipped or in a folder."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.splats.formats.splat_table import CONVERTER, Floats, SplatTable, with_largest
from topokit.errors import ReadError
from topokit.inputs.files import file_beside, head
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_bytes, require_expansion, require_members

Pixels = NDArray[np.uint8]
_META = "meta.json"
_LONGEST_META = 1 << 22  # bytes; real ones have about 15 000
_FREE_PIXELS = 1 << 20  # that an image may have, however few splats there are
_MOST_PER_SPLAT = 4  # pixels beyond that; writers round the sides of an image up, by a few pixels


def read_sog(path: Path) -> SplatTable:
    """Splats of a .sog file, or of an unzipped one given by its meta.json.

    Raises:
        ReadError: if the archive, its meta.json or an image is missing, damaged, of another version, or does not fit
            the number of splats.

    Reference:
        https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/
    """
    if not zipfile.is_zipfile(path):
        if head(path, 2) == b"PK":
            raise ReadError(f"{path} is a zip archive without its directory at the end: it is truncated.")
        return _decode(path, lambda name: _from_folder(path, name))
    with reading(path, "zipfile", NotImplementedError):
        archive = zipfile.ZipFile(path)
    with archive:
        return _decode(path, lambda name: _from_archive(path, archive, name))


def _from_folder(path: Path, name: str) -> bytes:
    file = path if name == _META else file_beside(path, name)
    size = file.stat().st_size
    if name == _META and size > _LONGEST_META:
        raise ReadError(f"{file} has {size} bytes; a .sog's meta.json has at most {_LONGEST_META}.")
    return file.read_bytes()


def _from_archive(path: Path, archive: zipfile.ZipFile, name: str) -> bytes:
    entries = [entry for entry in archive.infolist() if PurePosixPath(entry.filename).name == name]
    if not entries:
        raise ReadError(f"{path} holds no {name}; it is not a .sog file or it is truncated.")
    if name == _META and entries[0].file_size > _LONGEST_META:
        raise ReadError(f"{path}: its {_META} has {entries[0].file_size} bytes; at most {_LONGEST_META} were expected.")
    if entries[0].compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ReadError(
            f"{path}: {name} is packed by method {entries[0].compress_type}; stored or deflated is expected."
        )
    require_members(path, entries[:1])
    with reading(path, "zipfile", RuntimeError):  # an encrypted member
        return archive.read(entries[0])


def _decode(path: Path, fetch: Callable[[str], bytes]) -> SplatTable:
    with reading(path, "the JSON reader", RecursionError):
        meta = json.loads(fetch(_META))
    version = meta.get("version") if isinstance(meta, dict) else None
    if version != 2:
        raise ReadError(f"{path}: its meta.json is of version {version!r}; version 2 is known. {CONVERTER}")
    count = _entry(path, meta, "count")
    if not isinstance(count, int) or count < 1:
        raise ReadError(f"{path}: its meta.json gives {count!r} splats; expected a positive integer.")

    def pixels(attribute: str, which: int = 0) -> Pixels:
        name = _plain_name(path, _entry(path, meta, attribute, "files", which))
        return _image(f"{name} of {path}", fetch(name), count)

    rotations = pixels("quats")
    kind = rotations[:, 3].astype(np.int64) - 252
    if (kind < 0).any():
        raise ReadError(f"{path}: {int((kind < 0).sum())} rotations are not tagged 252 to 255; the file is damaged.")
    thirds = (rotations[:, :3].astype(np.float32) / np.float32(255) * 2 - 1) * np.float32(np.sqrt(0.5))
    ends = [_numbers(path, meta, 3, "means", end) for end in ("mins", "maxs")]
    codebook = _numbers(path, meta, 256, "scales", "codebook").astype(np.float32)
    return SplatTable(
        _means(ends[0], ends[1], pixels("means", 0), pixels("means", 1)),
        np.exp(codebook[pixels("scales")[:, :3]]),
        with_largest(kind, thirds),
        pixels("sh0")[:, 3].astype(np.float32) / np.float32(255),
    )


def _entry(path: Path, meta: Any, *keys: str | int) -> Any:
    """The entry of meta.json under these keys, one below the other."""
    for key in keys:
        entries = meta if isinstance(meta, dict) else dict(enumerate(meta)) if isinstance(meta, list) else {}
        if key not in entries:
            raise ReadError(f"{path}: its meta.json has no entry {'.'.join(map(str, keys))}; it is damaged.")
        meta = entries[key]
    return meta


def _numbers(path: Path, meta: Any, count: int, *keys: str) -> NDArray[np.float64]:
    values = _entry(path, meta, *keys)
    if not isinstance(values, list) or len(values) != count or not all(isinstance(v, int | float) for v in values):
        raise ReadError(f"{path}: {'.'.join(keys)} in its meta.json must be a list of {count} numbers.")
    return np.array(values, dtype=np.float64)


def _plain_name(path: Path, name: Any) -> str:
    if not isinstance(name, str) or not name or PurePosixPath(name).name != name or "\\" in name:
        raise ReadError(f"{path}: its meta.json names the image {name!r}; a plain file name was expected.")
    return name


def _means(low: NDArray[np.float64], high: NDArray[np.float64], fine: Pixels, coarse: Pixels) -> Floats:
    """16 bits between minimum and maximum, then sign(v)·(e^|v| − 1)."""
    share = (fine[:, :3].astype(np.float64) + 256 * coarse[:, :3].astype(np.float64)) / 65535
    value = low + (high - low) * share
    means: Floats = (np.sign(value) * np.expm1(np.abs(value))).astype(np.float32)
    return means


def _image(name: str, content: bytes, count: int) -> Pixels:
    """The first `count` pixels as (count, 4), sized by the image's own header before Pillow sees it."""
    width, height = _webp_size(name, content)
    if not count <= width * height <= max(_FREE_PIXELS, _MOST_PER_SPLAT * count):
        raise ReadError(f"{name} has {width} × {height} pixels, which do not fit {count} splats.")
    require_expansion(name, 4 * width * height, len(content))
    from PIL import Image

    damaged = (SyntaxError, Image.DecompressionBombError)
    with reading(name, "Pillow", *damaged), Image.open(io.BytesIO(content), formats=["WEBP"]) as image:
        return np.asarray(image.convert("RGBA")).reshape(-1, 4)[:count]


def _webp_size(name: str, content: bytes) -> tuple[int, int]:
    """Width and height of a lossless WebP file."""
    require_bytes(name, "a WebP image", 30, len(content))
    kind = content[12:16]
    if content[:4] != b"RIFF" or content[8:12] != b"WEBP" or kind not in (b"VP8L", b"VP8X"):
        raise ReadError(f"{name} is not a lossless WebP image: it is damaged or was converted on the way.")
    if kind == b"VP8X":
        return 1 + int.from_bytes(content[24:27], "little"), 1 + int.from_bytes(content[27:30], "little")
    bits = int.from_bytes(content[21:25], "little")
    return 1 + (bits & 16383), 1 + (bits >> 14 & 16383)
