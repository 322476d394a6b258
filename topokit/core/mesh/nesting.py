"""Which closed components of a mesh lie inside which, by winding numbers."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.mesh.boxes import boxes_around
from topokit.core.mesh.winding_numbers import winding_numbers


def nesting(
    vertices: Floats, faces: Integers, labels: Integers, shells: Booleans, low: Floats, high: Floats
) -> tuple[Integers, Integers]:
    """The innermost shell around every component, and how many are around it.

    A component is taken to be inside where its bounding box is and its first vertex is. Only pairs whose boxes are
    nested are tested.

    Args:
        vertices: (V, 3).
        faces: (F, 3), consistently oriented within each shell.
        labels: (F,) component of every face.
        shells: (C,) which components are closed and orientable, so that they can contain others.
        low: (C, 3) lowest corners of the bounding boxes.
        high: (C, 3) highest corners.

    Returns:
        Index of the innermost shell (C,), −1 for none, and number of shells (C,).
    """
    n_components = len(shells)
    first_face = np.full(n_components, len(faces))
    np.minimum.at(first_face, labels, np.arange(len(faces)))
    probes = vertices[faces[first_face, 0]]
    inner, outer = _nested_boxes(probes, low, high, np.flatnonzero(shells))
    is_outer = np.zeros(n_components, dtype=bool)
    is_outer[outer] = True
    chosen = is_outer[labels]
    is_inside = np.abs(winding_numbers(vertices, faces[chosen], labels[chosen], probes[inner], outer)) > 0.5
    inner, outer = inner[is_inside], outer[is_inside]
    depths = np.bincount(inner, minlength=n_components)
    order = np.lexsort((-outer, depths[outer]))  # the innermost last, of equals the first
    innermost = np.full(n_components, -1)
    innermost[inner[order]] = outer[order]
    return innermost, depths


def _nested_boxes(probes: Floats, low: Floats, high: Floats, shells: Integers) -> tuple[Integers, Integers]:
    """Components and shells other than themselves whose bounding box is around theirs."""
    found = [(np.zeros(0, dtype=np.int64),) * 2]
    one_group = np.zeros(len(probes), dtype=np.int64), np.zeros(len(shells), dtype=np.int64)
    for inner, index in boxes_around(probes, low[shells], high[shells], *one_group):
        outer = shells[index]
        is_nested = ((low[outer] <= low[inner]) & (high[inner] <= high[outer])).all(axis=1) & (inner != outer)
        found.append((inner[is_nested], outer[is_nested]))
    inner_lists, outer_lists = zip(*found, strict=True)
    return np.concatenate(inner_lists), np.concatenate(outer_lists)
