"""The geometry of a scene as a compact binary for the viewer."""

from __future__ import annotations

import gzip
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.export.colors import Floats
from topokit.export.scene import Scene

_STEPS = 65535  # of a coordinate along the longest side of the box, 16 bits
_UNKNOWN = -128  # the value of a vertex whose curvature is unknown; others are −127 … 127


def pack(scene: Scene) -> bytes:
    """A scene in gzip: length of the header (4 bytes), the header as JSON, then arrays, each from a multiple of 4.

    The header tells the lowest corner and the size of the box, the limit of the colors, the marks, and for each array
    its name, type and number of values. Coordinates are 16-bit steps of the box; curvatures are bytes, ±127 at the
    limits. All numbers are little-endian.
    """
    every = np.concatenate((scene.positions, *(mark.points for mark in scene.marks)))
    low, high = every.min(axis=0), every.max(axis=0)
    size = float((high - low).max()) or 1.0
    arrays: dict[str, NDArray[Any]] = {
        "positions": _quantized(scene.positions, low, size),
        "values": _bytes(scene.values / scene.limit),
    }
    if scene.faces is None:
        arrays["normals"] = _bytes(scene.normals)
    else:
        arrays["faces"] = scene.faces.astype("<u2" if len(scene.positions) <= _STEPS else "<u4")
    if scene.marks:
        arrays["marks"] = _quantized(np.concatenate([mark.points for mark in scene.marks]), low, size)
    header = {
        "low": low.tolist(),
        "size": size,
        "limit": scene.limit,
        "marks": [{"kind": mark.kind, "form": mark.form, "points": len(mark.points)} for mark in scene.marks],
        "arrays": [[name, values.dtype.str[1:], values.size] for name, values in arrays.items()],
    }
    text = _padded(json.dumps(header).encode(), b" ")
    parts = [len(text).to_bytes(4, "little"), text, *(_padded(values.tobytes(), b"\0") for values in arrays.values())]
    return gzip.compress(b"".join(parts), compresslevel=9, mtime=0)


def _quantized(positions: Floats, low: Floats, size: float) -> NDArray[np.uint16]:
    return np.rint((positions - low) / size * _STEPS).astype("<u2")


def _bytes(values: Floats) -> NDArray[np.int8]:
    scaled = np.rint(127 * np.clip(values, -1, 1))
    return np.where(np.isfinite(scaled), scaled, _UNKNOWN).astype(np.int8)


def _padded(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % 4)
