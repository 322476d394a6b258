"""Triangles of faces in whatever form they are given: arrays, padded arrays, lists of polygons."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Integers
from topokit.errors import InputError
from topokit.inputs.arrays import as_tensor

_FORMS = "(F, 3), (F, n) with −1 after the last corner of smaller polygons, or a list of lists"


def triangles(faces: object) -> Integers:
    """Faces of any number of corners as triangles.

    Args:
        faces: whole numbers in an array or tensor (F, n), where rows may end with −1 if n > 3, or a list of lists of
            different lengths.

    Returns:
        (T, 3) int64. Polygons are cut into fans, which leaves V − E + F as it is.

    Raises:
        InputError: if these are no whole numbers, or a face has fewer than three corners.
    """
    if isinstance(faces, list | tuple) and len({np.size(row) for row in faces}) > 1:
        return _fans_of_lists(faces)
    array = as_tensor(faces, "faces", _FORMS).detach().cpu().numpy()
    if array.ndim != 2 or array.shape[1] < 3:
        raise InputError(f"faces must have shape {_FORMS}; got {array.shape}.")
    rows = _integers(array)
    if rows.shape[1] == 3:
        return rows
    is_corner = rows != -1
    if (is_corner[:, 1:] & ~is_corner[:, :-1]).any():
        raise InputError("a face has −1 between its corners; −1 may only fill up the end of a row.")
    return fans(rows[is_corner], is_corner.sum(axis=1))


def fans(corners: Integers, counts: Integers) -> Integers:
    """Polygons cut into triangles that share their first corner.

    Args:
        corners: vertex indices of all polygons, one after the other.
        counts: (P,) number of corners of each.

    Returns:
        (T, 3), in the order of the polygons.

    Raises:
        InputError: if a polygon has fewer than three corners.
    """
    if (counts < 3).any():
        face = int(np.argmax(counts < 3))
        raise InputError(f"face {face} has {int(counts[face])} corners; at least 3 are needed.")
    n_triangles = counts - 2
    first = np.repeat(np.cumsum(counts) - counts, n_triangles)
    step = np.arange(n_triangles.sum()) - np.repeat(np.cumsum(n_triangles) - n_triangles, n_triangles)
    return corners[np.stack((first, first + step + 1, first + step + 2), axis=1)]


def _fans_of_lists(faces: list[object] | tuple[object, ...]) -> Integers:
    try:
        rows = [list(row) for row in faces]  # type: ignore[call-overload]
    except TypeError as error:
        raise InputError(f"faces could not be read as lists of vertex indices ({error}); expected {_FORMS}.") from error
    corners = as_tensor([corner for row in rows for corner in row], "faces", _FORMS).numpy()
    return fans(_integers(corners), np.array([len(row) for row in rows]))


def _integers(array: NDArray[Any]) -> Integers:
    is_whole = array.dtype.kind in "iu" or (array.dtype.kind == "f" and bool((array == np.rint(array)).all()))
    if not is_whole or not np.isfinite(array).all():
        hint = " For points and normals use topokit.from_points." if array.dtype.kind == "f" else ""
        raise InputError(f"faces must be whole numbers, got {array.dtype}.{hint}")
    return array.astype(np.int64)
