"""How often closed surfaces of triangles wind around points: 1 inside, 0 outside. Exact.

That of meshes that are not closed is approximated on a grid, in `solid_by_winding`.
"""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Floats, Integers
from topokit.core.mesh.boxes import boxes_around


def winding_numbers(
    vertices: Floats, faces: Integers, face_groups: Integers, points: Floats, point_groups: Integers
) -> Floats:
    """How often closed surfaces wind around points.

    A vertical line goes through every point. Each face that it passes counts by the direction in which it passes, with
    opposite signs above and below the point, and half the sum is the winding number. A line through an edge or a vertex
    counts once, because both faces at an edge decide alike on which side of the line it is.

    Args:
        vertices: (V, 3).
        faces: (F, 3), closed and consistently oriented within each group.
        face_groups: (F,) which surface a face belongs to.
        points: (P, 3).
        point_groups: (P,) which surface's winding number each point is asked for.

    Returns:
        (P,): 1 inside and 0 outside an outward surface without self-intersections, −1 inside an inward one, and halves
        at points of the surface itself. Only faces whose shadow's box holds the point's are tested.
    """
    corners = vertices[faces]
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    doubled = np.zeros(len(points))
    for point, face in boxes_around(points[:, :2], low, high, point_groups, face_groups):
        turns = _shadow_turns(vertices, faces[face], points[point])
        passed = np.flatnonzero(turns)
        point, face, turns = point[passed], face[passed], turns[passed]
        sides = np.sign(_heights(corners[face], points[point]))
        doubled += np.bincount(point, turns * sides, len(points))
    return doubled / 2


def _shadow_turns(vertices: Floats, faces: Integers, points: Floats) -> Integers:
    """Turns of the faces' shadows on the xy-plane around the points', pair by pair: 1, −1 or 0."""
    turns = np.zeros(len(faces), dtype=np.int64)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        is_forward = faces[:, start] < faces[:, end]  # both faces at an edge compute with the same numbers
        a = vertices[np.where(is_forward, faces[:, start], faces[:, end])] - points
        b = vertices[np.where(is_forward, faces[:, end], faces[:, start])] - points
        rises = (b[:, 1] > 0).astype(np.int64) - (a[:, 1] > 0)  # 1 or −1 where the edge crosses the line y = 0
        is_right = (a[:, 0] * b[:, 1] > b[:, 0] * a[:, 1]) == (rises > 0)
        turns += np.where(is_right, np.where(is_forward, rises, -rises), 0)
    return turns


def _heights(triangles: Floats, points: Floats) -> Floats:
    """Heights above points at which the vertical lines through them pass triangles, pair by pair.

    The plane y = 0 through a point cuts two edges of such a triangle, one upward in y and one downward; the height is
    interpolated between the two cuts, which also serves triangles that are seen edge-on.
    """
    corners = triangles - points[:, None]
    begin, end = corners, np.roll(corners, -1, axis=1)
    rises = (end[..., 1] > 0).astype(np.int64) - (begin[..., 1] > 0)
    along = begin[..., 1] / np.where(rises != 0, begin[..., 1] - end[..., 1], 1.0)
    cuts = begin + along[..., None] * (end - begin)
    up, down = (np.where((rises == sign)[..., None], cuts, 0.0).sum(axis=1) for sign in (1, -1))
    width = up[:, 0] - down[:, 0]
    share = np.where(width == 0, 0.5, up[:, 0] / np.where(width == 0, 1.0, width))
    return up[:, 2] + np.clip(share, 0.0, 1.0) * (down[:, 2] - up[:, 2])
