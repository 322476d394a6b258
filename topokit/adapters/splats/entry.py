"""The formats of Gaussian splats, and how they are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path

from topokit.inputs.files import GZIP, ZIP, member_names
from topokit.inputs.formats import Format, is_certainly, never, suffixes_of
from topokit.inputs.headers import ply_kind, ply_properties
from topokit.plugins.adapter import Adapter

SPZ = b"NGSP"
_KSPLAT_HEADER = 4096  # bytes


def is_splats(source: Path) -> bool:
    """Whether the content is a splat format; an .splat, which is bare numbers, is known by its suffix only."""
    path = scene_file(source)
    return path.is_file() and is_certainly(FORMATS, path)


def scene_file(source: str | os.PathLike[str]) -> Path:
    """The path itself; for the folder of an unzipped .sog its meta.json."""
    path = Path(source)
    return path / "meta.json" if (path / "meta.json").is_file() else path


def _is_sog(path: Path, start: bytes) -> bool:
    """Whether this is an archive with a meta.json, or a meta.json with the tables of a scene."""
    if start.startswith(ZIP):
        return _is_sog_archive(path)
    return re.match(rb"\s*\{", start) is not None and b'"means"' in start and b'"quats"' in start


def _is_sog_archive(path: Path) -> bool:
    """Whether a zip archive holds a meta.json: 3MF, NumPy and office files do not."""
    names = member_names(path)
    if names is None:
        return path.suffix.lower() == ".sog"  # its reader reports what is wrong with it
    return any(name.rpartition("/")[2] == "meta.json" for name in names)


def _is_spz(path: Path, start: bytes) -> bool:
    """Plain or gzipped."""
    if not start.startswith(GZIP):
        return start.startswith(SPZ)
    try:
        return zlib.decompressobj(wbits=31).decompress(start, len(SPZ)) == SPZ
    except zlib.error:
        return False


def _is_ksplat(path: Path, start: bytes) -> bool:
    """Version 0.1, compression level 0 to 2, and a header that is otherwise full of zeros."""
    is_known = len(start) >= _KSPLAT_HEADER and start[:4] == b"\0\1\0\0" and start[20] <= 2
    return is_known and not any(start[44:_KSPLAT_HEADER])


def _is_compressed(path: Path, start: bytes) -> bool:
    """Whether a .ply file holds splats in packed form."""
    return ply_kind(start) == "splats" and b"packed_position" in ply_properties(start)


_HERE = "topokit.adapters.splats.formats"
FORMATS = (
    Format("compressed ply", (), _is_compressed, f"{_HERE}.compressed_ply:read_compressed_ply"),
    Format("ply", (".ply",), lambda path, start: ply_kind(start) == "splats", f"{_HERE}.ply:read_ply"),
    Format("spz", (".spz",), _is_spz, f"{_HERE}.spz:read_spz"),
    Format("sog", (".sog",), _is_sog, f"{_HERE}.sog:read_sog"),
    Format("ksplat", (".ksplat",), _is_ksplat, f"{_HERE}.ksplat:read_ksplat"),
    Format("splat", (".splat",), never, f"{_HERE}.splat:read_splat"),  # bare numbers
)

SPLATS = Adapter(
    name="splats",
    description="Gaussian splats; for .sog also its unzipped folder",
    suffixes=suffixes_of(FORMATS),
    can_open=is_splats,
    types=("topokit.adapters.splats.gaussians.GaussianSplats", "torch.nn.ParameterDict", "builtins.dict"),
    extra="topokit[splats]",
    differentiable=True,
    opener="topokit.adapters.splats.adapter:from_splats",
    write_kept="topokit.adapters.splats.adapter:write_kept",
)
