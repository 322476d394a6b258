"""Which adapter opens what: by name, else by content, else by suffix."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topokit.errors import InputError, ReadError, UnknownFormatError
from topokit.files import array_shapes, existing_file, file_of_folder, head, unpacked_head

if TYPE_CHECKING:
    from topokit.shape import Shape

_HEAD = 1 << 16


@dataclass(frozen=True)
class _Entry:
    """One adapter, by lazy name: nothing is imported before a file asks for it."""

    name: str
    opener: str
    suffixes: tuple[str, ...]

    def open(self, path: Path, options: dict[str, Any]) -> Shape:
        module, _, function = self.opener.partition(":")
        return getattr(importlib.import_module(module), function)(path, **options)


_MESH = _Entry("mesh", "topokit.adapters.mesh:from_mesh", (".obj", ".off", ".stl", ".glb", ".gltf", ".3mf", ".ply"))
_POINTS = _Entry(
    "points",
    "topokit.adapters.points:from_points",
    (".xyz", ".txt", ".csv", ".pwn", ".pts", ".asc", ".npy", ".npz", ".pcd", ".las", ".laz", ".ply"),
)
_SPLATS = _Entry("splats", "topokit.adapters.splats.adapter:from_splats", (".splat", ".spz", ".sog", ".ksplat", ".ply"))
_SDF = _Entry("sdf", "topokit.adapters.implicit:from_sdf", (".pt", ".pth", ".pt2", ".ts"))
_OCCUPANCY = _Entry("occupancy", "topokit.adapters.implicit:from_occupancy", ())
_VOXELS = _Entry("voxels", "topokit.adapters.voxels:from_voxels", (".nii", ".nii.gz", ".nrrd", ".tif", ".tiff"))
_TABLE = {entry.name: entry for entry in (_MESH, _POINTS, _SPLATS, _SDF, _OCCUPANCY, _VOXELS)}


def load(source: str | os.PathLike[str], *, adapter: str | None = None, **options: Any) -> Shape:
    """Open a file with the adapter that its content, or failing that its suffix, asks for.

    Args:
        source: path of the file, or of the folder of an unzipped .sog.
        adapter: name of an adapter ("mesh", "points", "splats", "sdf", "occupancy", "voxels") that settles the choice.
        options: handed on to the adapter (`n_samples`, `n_neighbors`, `generator`, ...); see its docstring.

    Raises:
        ReadError: if the file is missing or malformed.
        UnknownFormatError: if neither content nor suffix is known.
        InputError: if `adapter` is not known or an option does not exist for it.
    """
    path = existing_file(file_of_folder(source))
    if adapter is not None and adapter not in _TABLE:
        raise InputError(f"adapter {adapter!r} is not known. Known: {', '.join(_TABLE)}.")
    entry = _TABLE[adapter] if adapter is not None else _choose(path)
    return entry.open(path, _accepted(entry, options))


def _choose(path: Path) -> _Entry:
    beginning = head(path, _HEAD)
    if _is_splats(path, beginning):
        return _SPLATS
    for looks_like, answer in _CONTENT:
        if looks_like(beginning):
            return answer(path, beginning)
    suffix = path.suffix.lower()
    for entry in _TABLE.values():
        if suffix in entry.suffixes:
            return entry
    known = ", ".join(sorted({suffix for entry in _TABLE.values() for suffix in entry.suffixes}))
    raise UnknownFormatError(
        f"{path}: {suffix or 'a file without suffix'!r} is not a known format and its content is not one either. "
        f"Known: {known}. Pass adapter={' or '.join(repr(name) for name in _TABLE)} if you know what it is."
    )


def _accepted(entry: _Entry, options: dict[str, Any]) -> dict[str, Any]:
    """Samples are a matter of meshes; a cloud is what it is."""
    if entry is _POINTS:
        options = {key: value for key, value in options.items() if key not in ("n_samples", "generator")}
    return options


def _is_splats(path: Path, beginning: bytes) -> bool:
    formats = importlib.import_module("topokit.adapters.splats.formats")
    return formats.reader_by_content(path, beginning) is not None


def _ply(path: Path, beginning: bytes) -> _Entry:
    header = beginning.partition(b"end_header")[0]
    faces = re.search(rb"element\s+(?:face|tristrips)\s+(\d+)", header)
    return _MESH if faces and int(faces.group(1)) > 0 else _POINTS


def _zip(path: Path, beginning: bytes) -> _Entry:
    if b"3D/" in beginning or b"[Content_Types].xml" in beginning:
        return _MESH
    if b".npy" in beginning:
        return _numpy(path, beginning)
    if b".pkl" in beginning or path.suffix.lower() in _SDF.suffixes:
        return _SDF
    raise ReadError(
        f"{path} is a zip archive, but neither a 3MF model nor a NumPy archive, nor a .sog scene, nor a network; "
        "unpack it first."
    )


def _numpy(path: Path, beginning: bytes) -> _Entry:
    """A 3-D array is a volume, unless the archive names points."""
    shapes = array_shapes(path)
    is_volume = "points" not in shapes and any(len(shape) == 3 for shape in shapes.values())
    return _VOXELS if is_volume else _POINTS


def _gzip(path: Path, beginning: bytes) -> _Entry:
    if _is_nifti(unpacked_head(path)):
        return _VOXELS
    raise ReadError(f"{path} is compressed with gzip and holds no NIfTI volume; unpack it first.")


def _is_nifti(start: bytes) -> bool:
    return start[344:347] in (b"n+1", b"ni1") or start[4:7] == b"n+2"


_CONTENT: tuple[tuple[Callable[[bytes], bool], Callable[[Path, bytes], _Entry]], ...] = (
    (lambda start: start.startswith(b"ply"), _ply),
    (lambda start: start.startswith(b"PK\x03\x04"), _zip),
    (lambda start: re.match(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b", start) is not None, lambda *_: _MESH),
    (lambda start: start.startswith(b"glTF"), lambda *_: _MESH),
    (lambda start: start.startswith(b"solid") and b"facet" in start, lambda *_: _MESH),
    (lambda start: start.startswith(b"\x93NUMPY"), _numpy),
    (lambda start: start.startswith(b"\x1f\x8b"), _gzip),
    (_is_nifti, lambda *_: _VOXELS),
    (lambda start: start.startswith((b"NRRD0", b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")), lambda *_: _VOXELS),
    (lambda start: start.startswith((b"LASF", b"# .PCD")), lambda *_: _POINTS),
    (lambda start: re.search(rb"^FIELDS .*\n(.*\n)*?DATA ", start, re.MULTILINE) is not None, lambda *_: _POINTS),
)
