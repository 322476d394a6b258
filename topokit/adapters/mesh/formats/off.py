"""ASCII OFF files with polygons of any size."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.mesh.polygons import fans
from topokit.errors import FOR_POINTS, ReadError


def read_off(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """An ASCII OFF file with polygons of any size, cut into fans.

    Raises:
        ReadError: if counts and content do not agree.
    """
    lines = (line.split("#")[0] for line in path.read_text(encoding="utf-8", errors="strict").splitlines())
    words = [line.split() for line in lines]
    rows = [row for row in words if row]
    if not rows or not rows[0][0].upper().endswith("OFF"):
        raise ReadError(f"{path} is not an OFF file: it does not begin with OFF.")
    rows[0] = rows[0][1:]
    rows = rows if rows[0] else rows[1:]
    if not rows or len(rows[0]) < 2:
        raise ReadError(f"{path} has no vertex and face counts after its first word; it is truncated.")
    n_vertices, n_faces = int(rows[0][0]), int(rows[0][1])
    if len(rows) < 1 + n_vertices + n_faces:
        raise ReadError(
            f"{path} announces {n_vertices} vertices and {n_faces} faces but has only {len(rows) - 1} lines for them: "
            "it is truncated or its header is wrong."
        )
    vertices = np.array([row[:3] for row in rows[1 : 1 + n_vertices]], dtype=np.float64).reshape(-1, 3)
    polygons = [row for row in rows[1 + n_vertices : 1 + n_vertices + n_faces] if int(row[0]) > 2]
    if not polygons:
        raise ReadError(f"{path} holds no faces. A mesh was expected; for points use ", FOR_POINTS, ".")
    counts = np.array([int(row[0]) for row in polygons])
    short = next((row for row, count in zip(polygons, counts, strict=True) if len(row) <= count), None)
    if short is not None:
        raise ReadError(f"{path}: a face announces {short[0]} corners and has {len(short) - 1}.")
    words_of_corners = chain.from_iterable(row[1 : 1 + n] for row, n in zip(polygons, counts.tolist(), strict=True))
    return vertices, fans(np.array(list(map(int, words_of_corners)), dtype=np.int64), counts)
