"""How Gaussian splats are recognized; nothing that reads them is imported here."""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path
from typing import Literal

from topokit.inputs.files import GZIP, ZIP, head, member_names
from topokit.inputs.ply_header import ply_kind, ply_properties
from topokit.plugins.adapter import Adapter

Format = Literal["ply", "compressed ply", "splat", "spz", "sog", "ksplat"]
SPZ = b"NGSP"
_KSPLAT_HEADER = 4096  # bytes


def is_splats(source: Path) -> bool:
    """Whether the content is a splat format; an .splat, which is bare numbers, is known by its suffix only."""
    path = scene_file(source)
    return path.is_file() and format_by_content(path) is not None


def scene_file(source: str | os.PathLike[str]) -> Path:
    """The path itself; for the folder of an unzipped .sog its meta.json."""
    path = Path(source)
    return path / "meta.json" if (path / "meta.json").is_file() else path


def format_by_content(path: Path) -> Format | None:
    """The splat format that a file's content shows, or None."""
    start = head(path)
    if ply_kind(start) == "splats":
        return "compressed ply" if b"packed_position" in ply_properties(start) else "ply"
    if start.startswith(ZIP):
        return "sog" if _is_sog_archive(path) else None
    if re.match(rb"\s*\{", start):
        return "sog" if b'"means"' in start and b'"quats"' in start else None
    if _is_spz(start):
        return "spz"
    return "ksplat" if _is_ksplat(start) else None


def _is_sog_archive(path: Path) -> bool:
    """Whether a zip archive holds a meta.json: 3MF, NumPy and office files do not."""
    names = member_names(path)
    if names is None:
        return path.suffix.lower() == ".sog"  # its reader reports what is wrong with it
    return any(name.rpartition("/")[2] == "meta.json" for name in names)


def _is_spz(start: bytes) -> bool:
    """Plain or gzipped."""
    if not start.startswith(GZIP):
        return start.startswith(SPZ)
    try:
        return zlib.decompressobj(wbits=31).decompress(start, len(SPZ)) == SPZ
    except zlib.error:
        return False


def _is_ksplat(start: bytes) -> bool:
    """Version 0.1, compression level 0 to 2, and a header that is otherwise full of zeros."""
    is_known = len(start) >= _KSPLAT_HEADER and start[:4] == b"\0\1\0\0" and start[20] <= 2
    return is_known and not any(start[44:_KSPLAT_HEADER])


SPLATS = Adapter(
    name="splats",
    description="Gaussian splats; for .sog also its unzipped folder",
    suffixes=(".ply", ".splat", ".spz", ".sog", ".ksplat"),
    can_open=is_splats,
    types=("topokit.adapters.splats.gaussians.GaussianSplats", "torch.nn.ParameterDict", "builtins.dict"),
    extra="topokit[splats]",
    differentiable=True,
    opener="topokit.adapters.splats.adapter:from_splats",
)
