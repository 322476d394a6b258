"""A conforming triangulation of the leaves of a balanced octree, with values at its vertices.

A leaf none of whose edges is halved by a smaller one has six tetrahedra, along the diagonal from the corner of even to
that of odd coordinates (the union-jack triangulation J1). Any other leaf is a cone from its center over its faces; a
face with a halved edge is a fan from its own center. Around halved edges the diagonals of the smaller faces are those
of the fan, so the faces of neighbors agree.

Beside creases the value at a vertex is the mean of the function at eight points around it: where values from both sides
of a crease are interpolated, the result may fall along directions in which the function rises; that of means seldom
does, and `relaxation` changes it where it does.

Reference:
    Todd, The Computation of Fixed Points and Applications, 1976 (J1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import permutations
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.implicit.certificate.cells import DEEPEST, OFFSETS, Leaves, Octree, code
from topokit.core.surface import TriangleSurface

_UNIT = 1 << (DEEPEST + 1)  # positions are whole numbers: half of the smallest cell
_EDGES = [(axis, corner) for axis in range(3) for corner in range(8) if OFFSETS[corner][axis] == 0]
_PATHS = [
    np.cumsum([np.zeros(3, np.int64), *np.eye(3, dtype=np.int64)[list(order)]], axis=0)
    for order in permutations(range(3))
]
_CREASED = 0.25  # spread of the gradient in a leaf, as share of its size, from which values are means
_TINY = 1e-300  # instead of 0 at a vertex: any value does, see `proof`

Values = Callable[[Floats], Floats]
Bounded = Callable[[Floats], tuple[Floats, Floats]]


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Tetrahedra with values at their vertices.

    Attributes:
        vertices: (V, 3), in halves of the smallest cell that may be.
        scale: (3,) such a half.
        positions: (V, 3) of the vertices.
        value: (V,) about the function there; never 0.
        octants: (V,) eighths of the box around a vertex that leaves cover: fewer than 8 beside empty cells.
        is_sure: (V,) whether the value has the function's sign as far as it must: beside empty cells.
        is_free: (V,) whether other values serve: inside of the box. Beside empty cells they must have the same sign.
        reach: (V,) sides of the boxes over which values are means, in the same halves; 0 for values at the points.
        is_new: (V,) whether the value is not that of the triangulation before.
        tetrahedra: (T, 4) vertices.
        owner: (T,) the leaf of each.
        gradient: (T, 3) of the interpolated values, which are linear in a tetrahedron.
        slack: (T, 3) bounds of its rounding errors.
    """

    vertices: Integers
    scale: Floats
    positions: Floats
    value: Floats
    octants: Integers
    is_sure: Booleans
    is_free: Booleans
    reach: Integers
    is_new: Booleans
    tetrahedra: Integers
    owner: Integers
    gradient: Tensor
    slack: Tensor

    def with_values(self, value: Floats) -> Triangulation:
        """The same tetrahedra with other values (V,)."""
        value = np.where(value == 0, _TINY, value)
        changed = np.nonzero(self.have(value != self.value))[0]
        gradient, slack = self.gradient.clone(), self.slack.clone()
        gradient[changed], slack[changed] = _linear_gradients(
            self.vertices, self.scale, value, self.tetrahedra[changed]
        )
        return replace(self, value=value, gradient=gradient, slack=slack)

    def have(self, chosen: Booleans) -> Booleans:
        """(T,) whether tetrahedra have any of the chosen (V,) vertices."""
        a, b, c, d = self.tetrahedra.T
        found: Booleans = chosen[a] | chosen[b] | chosen[c] | chosen[d]
        return found

    def surface(self) -> TriangleSurface:
        """The zero set of the interpolated values."""
        return _zero_set(self.positions, self.value, self.tetrahedra)


def triangulate(
    tree: Octree, leaves: Leaves, values: Values, bounded: Bounded, before: Triangulation | None = None
) -> Triangulation:
    """The triangulation of leaves.

    Args:
        tree: theirs.
        leaves: balanced (see `cells.unbalanced`).
        values: the function at points, about.
        bounded: the same with bounds of the errors, used beside empty cells.
        before: that before some leaves were divided; vertices around which nothing changed keep its values.
    """
    size = _UNIT >> leaves.level
    corner = leaves.index * size[:, None]
    is_halved = _halved_edges(leaves, corner, size)
    plain, every = np.nonzero(~is_halved.any(1))[0], np.arange(len(size))
    corners = (corner[:, None] + OFFSETS * size[:, None, None]).reshape(-1, 3)
    shares = [_Share(corners, np.repeat(every, 8), 1)]
    found = [_plain(leaves, corner, size, plain), *_cones(leaves, corner, size, is_halved, shares)]
    points = np.concatenate([part for part, _ in found]).reshape(-1, 3)
    codes, first, vertex = np.unique(code(points), return_index=True, return_inverse=True)
    vertices, tetrahedra = points[first], vertex.reshape(-1, 4)
    scale = tree.side / (tree.root * float(_UNIT))
    positions = tree.low + vertices * scale
    octants, reach = _around(leaves, size, codes, shares)
    at_box = (vertices == 0) | (vertices == tree.root * _UNIT)
    octants <<= at_box.sum(1)  # beyond the box there is nothing to cover
    reach[at_box.any(1)] = 0
    value, is_sure = np.zeros(len(codes)), np.ones(len(codes), dtype=bool)
    is_new: Booleans = np.ones(len(codes), dtype=bool)
    if before is not None:
        here, there = _unchanged(before, codes, octants, reach)
        value[here], is_sure[here], is_new[here] = before.value[there], before.is_sure[there], False
    new = np.nonzero(is_new)[0]
    value[new], is_sure[new] = _valued(positions[new], octants[new], reach[new, None] / 2 * scale, values, bounded)
    gradient, slack = _linear_gradients(vertices, scale, value, tetrahedra)
    return Triangulation(
        *(vertices, scale, positions, value, octants, is_sure, ~at_box.any(1), reach, is_new),
        *(tetrahedra, np.concatenate([rows for _, rows in found]), gradient, slack),
    )


def _unchanged(before: Triangulation, codes: Integers, octants: Integers, reach: Integers) -> tuple[Integers, Integers]:
    """Vertices around which nothing changed: their numbers (m,), and those they had before."""
    old = code(before.vertices)
    place = np.searchsorted(old, codes).clip(max=len(old) - 1)
    is_same = (old[place] == codes) & (before.octants[place] == octants) & (before.reach[place] == reach)
    here = np.nonzero(is_same)[0]
    return here, place[here]


def _valued(
    positions: Floats, octants: Integers, reach: Floats, values: Values, bounded: Bounded
) -> tuple[Floats, Booleans]:
    """(n,) values at vertices, means over boxes that reach (n, 3), and (n,) whether they have the sign they need."""
    exact = values(positions)
    beside = np.nonzero(octants < 8)[0]
    exact[beside], error = bounded(positions[beside])
    value = exact.copy()
    creased = np.nonzero(reach.any(1))[0]
    value[creased] = _means(positions[creased], reach[creased], values)
    value = np.where((octants < 8) & ((value > 0) != (exact > 0)), exact, value)
    is_sure: Booleans = np.ones(len(exact), dtype=bool)
    is_sure[beside] = np.abs(exact[beside]) > error
    return np.where(value == 0, _TINY, value), is_sure


class _Share(NamedTuple):
    """Vertices (m, 3) of leaves (m,), and how many octants around them are in these."""

    places: Integers
    rows: Integers
    octants: int


def _around(leaves: Leaves, size: Integers, codes: Integers, shares: list[_Share]) -> tuple[Integers, Integers]:
    """Octants (V,) covered by leaves, and the smallest size of the leaves around vertices of creased ones, else 0."""
    center, spread = leaves.gradient.center.norm(dim=1), leaves.gradient.spread.norm(dim=1)
    is_creased = (spread > _CREASED * center).numpy()
    octants, smallest = np.zeros(len(codes), np.int64), np.full(len(codes), _UNIT)
    touches = np.zeros(len(codes), dtype=bool)
    for share in shares:
        vertex = np.searchsorted(codes, code(share.places))
        octants += share.octants * np.bincount(vertex, minlength=len(codes))
        np.minimum.at(smallest, vertex, size[share.rows])
        touches[vertex[is_creased[share.rows]]] = True
    return octants, np.where(touches, smallest, 0)


def _means(positions: Floats, reach: Floats, values: Values) -> Floats:
    """The mean of the function at the corners of boxes around points (n, 3) that reach so far."""
    total: Floats = np.zeros(len(positions))
    for corner in 2 * OFFSETS - 1:
        total += values(positions + corner * reach)
    return total / 8


def _halved_edges(leaves: Leaves, corner: Integers, size: Integers) -> Booleans:
    """(n, 12) whether a smaller leaf ends in the middle of an edge."""
    starts = np.stack([corner + OFFSETS[c] * size[:, None] for _, c in _EDGES], axis=1)
    along = np.array([axis for axis, _ in _EDGES])
    unit = np.eye(3, dtype=np.int64)[along]
    double = 2 * size[:, None, None]
    is_half = ((starts % double == 0) | (unit == 1)).all(2)  # of an edge of the next larger cells
    is_second = (starts * unit % double).any(2)
    middles = np.where(is_second[..., None], starts, starts + unit * size[:, None, None])
    own = starts + unit * (size // 2)[:, None, None]
    ends = np.unique(code(middles[is_half]))
    return np.isin(code(own.reshape(-1, 3)), ends).reshape(-1, 12)


def _plain(leaves: Leaves, corner: Integers, size: Integers, rows: Integers) -> tuple[Integers, Integers]:
    """The six tetrahedra of leaves: points (6m, 4, 3) and their leaves."""
    odd = leaves.index[rows] & 1
    parts = [corner[rows, None] + (path[None] ^ odd[:, None]) * size[rows, None, None] for path in _PATHS]
    return np.concatenate(parts), np.tile(rows, len(parts))


def _cones(
    leaves: Leaves, corner: Integers, size: Integers, is_halved: Booleans, shares: list[_Share]
) -> list[tuple[Integers, Integers]]:
    """The tetrahedra of leaves with a halved edge; adds the vertices that are no corners, with their octants."""
    found: list[tuple[Integers, Integers]] = []

    def cone(rows: Integers, *base: Integers) -> None:
        """Add the tetrahedra from the leaves' centers over triangles, given by points (m, 3) in half sides."""
        half = size[rows, None] // 2
        points = [corner[rows] + half * place for place in (np.ones(3, np.int64), *base)]
        found.append((np.stack(points, axis=1), rows))

    rows = np.nonzero(is_halved.any(1))[0]
    shares.append(_Share(corner[rows] + size[rows, None] // 2, rows, 8))
    for number, (axis, start) in enumerate(_EDGES):
        halved = np.nonzero(is_halved[:, number])[0]
        middle = 2 * OFFSETS[start] + np.eye(3, dtype=np.int64)[axis]
        shares.append(_Share(corner[halved] + size[halved, None] // 2 * middle, halved, 2))
    for axis in range(3):
        for side in (0, 2):
            edges = [n for n, (along, c) in enumerate(_EDGES) if along != axis and 2 * OFFSETS[c][axis] == side]
            is_fan = is_halved[rows][:, edges].any(1)
            fans, flat = rows[is_fan], rows[~is_fan]
            center = np.ones(3, dtype=np.int64)
            center[axis] = side
            shares.append(_Share(corner[fans] + size[fans, None] // 2 * center, fans, 4))
            for number in edges:
                along, start = _EDGES[number]
                a = 2 * OFFSETS[start]
                middle, b = (a + np.eye(3, dtype=np.int64)[along] * step for step in (1, 2))
                split = fans[is_halved[fans, number]]
                cone(fans[~is_halved[fans, number]], center, a, b)
                cone(split, center, a, middle)
                cone(split, center, middle, b)
            u, v = (other for other in range(3) if other != axis)
            even = 2 * (leaves.index[flat] & 1)  # on which side the coordinates are even
            first = even.copy()
            first[:, axis] = side
            last = 2 - even
            last[:, axis] = side
            for turned in (u, v):
                third = first.copy()
                third[:, turned] = last[:, turned]
                cone(flat, first, third, last)
    return found


def _linear_gradients(vertices: Integers, scale: Floats, value: Floats, tetrahedra: Integers) -> tuple[Tensor, Tensor]:
    """(T, 3) gradients of linear interpolation, and bounds of their rounding errors.

    The edges are small whole numbers times the scale; the three rows of the inverse are cross products, exact in double
    precision up to the division, so every gradient is within 2⁻⁴⁵ of the sum of the magnitudes that make it.
    """
    gradients, slacks = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for start in range(0, len(tetrahedra), 1 << 17):
        rows = tetrahedra[start : start + (1 << 17)]
        points, values = vertices[rows], value[rows]
        a, b, c = (points[:, k] - points[:, 0] for k in (1, 2, 3))
        unit = np.maximum(np.abs(a), np.maximum(np.abs(b), np.abs(c))).max(1)[:, None]
        a, b, c = a / unit, b / unit, c / unit  # multiples of 1/4: all exact
        across = np.stack((np.cross(b, c), np.cross(c, a), np.cross(a, b)), axis=1)
        determinant = (a * across[:, 0]).sum(1)[:, None, None]
        parts = (values[:, 1:] - values[:, :1])[:, :, None] * across / determinant / (unit * scale)[:, None]
        gradients.append(parts.sum(1))
        slacks.append(2.0**-45 * np.abs(parts).sum(1))
    return torch.from_numpy(np.concatenate(gradients)), torch.from_numpy(np.concatenate(slacks))


def _zero_set(positions: Floats, value: Floats, tetrahedra: Integers) -> TriangleSurface:
    """Triangles where linear interpolation in tetrahedra is 0, one vertex on every edge with a change of sign."""
    inside = value[tetrahedra] > 0
    order = np.argsort(~inside, axis=1, kind="stable")
    count = inside.sum(1)
    sorted_vertices = np.take_along_axis(tetrahedra, order, axis=1)
    one, two, three = (sorted_vertices[count == n] for n in (1, 2, 3))

    def edges(part: Integers, *ends: tuple[int, int]) -> Integers:
        return np.stack([np.sort(part[:, list(pair)], axis=1) for pair in ends], axis=1)

    triangles = np.concatenate(
        (
            edges(one, (0, 1), (0, 2), (0, 3)),
            edges(three, (0, 3), (1, 3), (2, 3)),
            edges(two, (0, 2), (0, 3), (1, 3)),
            edges(two, (0, 2), (1, 3), (1, 2)),
        )
    ).reshape(-1, 2)
    keys, faces = np.unique(triangles[:, 0] * len(value) + triangles[:, 1], return_inverse=True)
    low, high = np.divmod(keys, len(value))
    share = (value[low] / (value[low] - value[high])).clip(1e-3, 1 - 1e-3)[:, None]
    return TriangleSurface((1 - share) * positions[low] + share * positions[high], faces.reshape(-1, 3))
