"""Values at vertices that rise where interpolated ones do not.

Interpolation across a crease may fall along directions in which the function rises, however small the cells are. The
theorem in `proof` lets values be chosen. So some are moved, as little as it takes, until they rise along a direction in
which the function rises.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, hstack
from scipy.sparse.csgraph import connected_components

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.implicit.certificate.cells import Leaves
from topokit.core.implicit.certificate.conditions import directions, touching
from topokit.core.implicit.certificate.triangulation import Triangulation

_GOAL = 0.1  # rise of the values along a direction, as share of the least that the function's may be
_SIGNED = 0.99  # of a value beside an empty cell, which must keep its sign: most that may be taken from it
_FAR = 1e3  # sides of tetrahedra times slopes: more than any change that serves


def relaxed(leaves: Leaves, mesh: Triangulation, rows: Integers) -> Triangulation:
    """The triangulation with other values around leaves (numbers), as far as any serve.

    A linear program for each part of the leaves finds the smallest sum of changes, in sides of the tetrahedra around.
    """
    pairs = cell, tetrahedron = touching(mesh, rows, len(leaves.level))
    direction, least = directions(leaves, mesh, rows, pairs)
    has_direction = least[cell] > 0
    cell, tetrahedron = cell[has_direction], tetrahedron[has_direction]
    if not len(cell):
        return mesh
    corners = mesh.tetrahedra[tetrahedron]
    factors = (_hats(mesh.positions[corners]) * direction.numpy()[cell, None]).sum(2)
    lacking = _GOAL * least[cell] - (factors * mesh.value[corners]).sum(1)
    vertices, column = np.unique(corners, return_inverse=True)
    column = column.reshape(corners.shape)
    size = np.full(len(vertices), np.inf)
    np.minimum.at(size, column, np.ptp(mesh.positions[corners], axis=1).max(1)[:, None])
    size *= mesh.is_free[vertices]
    matrix = csr_array(((factors * size[column]).ravel(), column.ravel(), np.arange(0, 4 * len(cell) + 1, 4)))
    changes = _least_changes(matrix, -lacking, _most_changes(mesh, vertices, size))
    value = mesh.value.copy()
    value[vertices] += changes * size
    return mesh.with_values(value)


def _least_changes(matrix: csr_array, most: Floats, bounds: Floats) -> Floats:
    """(V,) the x of the smallest sum of magnitudes with −`matrix` x ≤ `most`; 0 in parts that have none.

    Args:
        matrix: (m, V).
        most: (m,)
        bounds: (V, 2) of how far each may fall and rise.
    """
    _, part = connected_components(matrix.T @ matrix, directed=False)
    part_of_row = part[matrix.indices[matrix.indptr[:-1]]]
    changes: Floats = np.zeros(len(part))
    for k in np.unique(part_of_row[most < 0]):
        columns, rows = np.nonzero(part == k)[0], np.nonzero(part_of_row == k)[0]
        own = matrix[rows][:, columns]
        limits = np.concatenate((bounds[columns, 1], bounds[columns, 0]))
        found = linprog(
            np.ones(len(limits)), hstack((-own, own)), most[rows], bounds=np.stack((0 * limits, limits), axis=1)
        )
        if found.x is not None:
            changes[columns] = found.x[: len(columns)] - found.x[len(columns) :]
    return changes


def _most_changes(mesh: Triangulation, vertices: Integers, size: Floats) -> Floats:
    """(V, 2) how far values may fall and rise, in sizes: beside empty cells signs stay."""
    value, is_signed = mesh.value[vertices], mesh.octants[vertices] < 8
    limit = _SIGNED * np.abs(value) / np.where(size > 0, size, 1.0)
    return np.stack([np.where(is_signed & (sign * value > 0), limit, _FAR) for sign in (1, -1)], axis=1)


def leaves_near(mesh: Triangulation, vertices: Booleans) -> Integers:
    """Leaves (ascending numbers) that touch a tetrahedron with one of the chosen (V,) vertices."""
    is_near = vertices.copy()
    is_near[mesh.tetrahedra[mesh.have(is_near)]] = True
    return np.unique(mesh.owner[mesh.have(is_near)])


def _hats(corners: Floats) -> Floats:
    """(n, 4, 3) gradients of the linear functions that are 1 at one corner of a tetrahedron (n, 4, 3), 0 at others."""
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
    hats: Floats = np.concatenate((-inverse.sum(1, keepdims=True), inverse), axis=1)
    return hats
