"""Boundary of a sampled surface: rim points, the closed curves they form, and their geodesic curvature."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.labels import connected_labels
from topokit.core.linalg import normalize, squared_norm, tangent_basis
from topokit.core.local.chunks import in_chunks
from topokit.core.local.curvature import at_neighbors, tangent_neighbors
from topokit.core.local.frames import normals_from_neighbors
from topokit.core.local.voronoi import CellVertices, cell_vertices, exact_cell_areas
from topokit.core.neighbors import nearest_neighbors
from topokit.core.precision import full_precision
from topokit.core.separation import separate

_GAP = 110.0  # degrees without a neighbor at a rim point; a straight boundary leaves 180
_SUPPORT = 3  # neighbors that must have a gap too
_LEAST_LOOP = 17  # points, and spacings of length, of the smallest boundary loop distinguishable from noise
_CLOSING = 0.2  # largest distance between the ends of a closed path, as a share of its length
_REACH = 6.0  # largest distance between successive points of a boundary curve, in spacings


def has_gap(tangent: Tensor, vertices: CellVertices) -> Tensor:
    """Whether a sector of 110° or more holds no neighbor, as beside the boundary of a surface.

    Only cells with such a sector between two adjacent Voronoi neighbors are tested: others have no wider one.

    Args:
        tangent: (m, k, 2), neighbors in the tangent plane of the center, which is the origin.
        vertices: of the Voronoi cells of the origin among these neighbors, or some of them.

    Returns:
        (m,) bool. Not differentiable.
    """
    first, second = (tangent.flatten(0, 1).index_select(0, row) for row in (vertices.first, vertices.second))
    lengths = (squared_norm(first) * squared_norm(second)).sqrt()
    is_narrow = (first * second).sum(-1) > math.cos(math.radians(_GAP - 1)) * lengths  # 1° for rounding
    is_candidate = vertices.is_unbounded.clone()
    is_candidate[vertices.cell[~is_narrow]] = True
    candidates = is_candidate.nonzero().squeeze(1)
    x, y = tangent[candidates].unbind(-1)
    angles = torch.atan2(y, x).sort(-1).values
    around = torch.cat((angles[:, 1:], angles[:, :1] + 2 * math.pi), dim=-1) - angles
    is_candidate[candidates] = around.amax(-1) > math.radians(_GAP)
    return is_candidate


@dataclass(frozen=True, eq=False)
class BoundaryCurve:
    """One closed boundary curve.

    Attributes:
        index: (M,) samples in the order of the curve.
        length: its length, in units of length.
        turning: ∮ k_g ds, the total geodesic curvature; 2π for the rim of a flat disc, −2π for a hole in it.
    """

    index: Tensor
    length: float
    turning: float


@dataclass(frozen=True, eq=False)
class BoundaryEstimate:
    """The boundary of one sampled surface.

    Attributes:
        curves: closed boundary curves, longest first.
        rim_share: share of the separate samples with neighbors on one side only.
        spacing: typical distance between separate samples, in units of length.
    """

    curves: tuple[BoundaryCurve, ...]
    rim_share: float
    spacing: float

    @property
    def euler(self) -> float:
        """The boundary's share of χ: Σ ∮ k_g ds / 2π."""
        return sum(curve.turning for curve in self.curves) / (2 * math.pi)

    @property
    def narrowest(self) -> float:
        """Width of the narrowest round hole whose rim can be told from noise, in units of length."""
        return _LEAST_LOOP * self.spacing / math.pi

    @property
    def length(self) -> float:
        """Total length of the curves, in units of length."""
        return sum(curve.length for curve in self.curves)


@full_precision
@torch.no_grad()
def estimate_boundary(points: Tensor, neighbors: Tensor) -> BoundaryEstimate:
    """Boundary curves of a sampled surface, from positions alone: input normals are misleading on thin parts.

    Samples that are nearer to each other than half their spacing count as one: pairs leave gaps in directions, but not
    in the surface.

    Args:
        points: (N, 3), any float dtype and device.
        neighbors: (N, k) indices, nearest first.

    Returns:
        `BoundaryEstimate`. Not differentiable.
    """
    kept = separate(points.detach(), neighbors)
    points = points.detach()[kept]
    neighbors = nearest_neighbors(points, min(neighbors.shape[1], len(points) - 1))

    def local(rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        offsets = at_neighbors(points, neighbors, rows) - points[rows, None]
        normals = normals_from_neighbors(offsets)
        frames = tangent_basis(normals, offsets[:, -1])
        tangent, same_sheet = tangent_neighbors(offsets, frames)
        own_sheet = tangent * same_sheet
        vertices = cell_vertices(own_sheet)
        return normals, has_gap(tangent, vertices), exact_cell_areas(own_sheet, vertices)[0]

    normals, gap, areas = in_chunks(local, len(points), points.device, neighbors.shape[1])
    rim = gap & (gap[neighbors].sum(-1) >= _SUPPORT)  # boundaries are curves: a rim point has rim points beside it
    spacing = float(areas.mean().sqrt())
    curves = boundary_curves(points, normals, rim, spacing)
    curves = tuple(replace(curve, index=kept.cpu()[curve.index]) for curve in curves)
    return BoundaryEstimate(curves, float(rim.double().mean()), spacing)


def boundary_curves(points: Tensor, normals: Tensor, is_rim: Tensor, spacing: float) -> tuple[BoundaryCurve, ...]:
    """Join rim points to closed curves and measure their total geodesic curvature.

    Each cluster is ordered along the longest path of its minimum spanning tree, whose ends must meet. The polygon is
    smoothed; its turning towards the surface is the boundary term of Gauss–Bonnet: χ = (∫ K dA + Σ ∮ k_g ds) / 2π.

    Args:
        points: (N, 3).
        normals: (N, 3) unit; signs do not matter.
        is_rim: (N,) bool, the rim points.
        spacing: typical distance of samples.

    Returns:
        The closed curves, longest first. Not differentiable.
    """
    rows = is_rim.nonzero().ravel().cpu().numpy()
    positions = points.detach().cpu().double().numpy()
    rows = rows[np.sort(np.unique(positions[rows], axis=0, return_index=True)[1])]  # pairs in one place are too many
    if len(rows) < _LEAST_LOOP:
        return ()
    directions = normals.detach().cpu().double().numpy()
    curves = []
    for cluster in _clusters(positions[rows], _REACH * spacing):
        order = _longest_path(positions[rows[cluster]], _REACH * spacing)
        path = rows[cluster[order]]
        gap = np.linalg.norm(positions[path[0]] - positions[path[-1]])
        length = np.linalg.norm(np.diff(positions[path], axis=0), axis=1).sum()
        if len(path) >= _LEAST_LOOP and gap <= max(2 * _REACH * spacing, _CLOSING * length):
            curves.append(_measure(path, positions, directions, spacing))
    curves = [curve for curve in curves if curve.length > _LEAST_LOOP * spacing]
    return tuple(sorted(curves, key=lambda curve: -curve.length))


def _clusters(positions: NDArray[np.float64], reach: float) -> list[NDArray[np.int64]]:
    """Indices of the points of each cluster that is large enough for a loop."""
    pairs = cKDTree(positions).query_pairs(reach, output_type="ndarray")
    labels = connected_labels(len(positions), pairs[:, 0], pairs[:, 1])
    large = np.flatnonzero(np.bincount(labels) >= _LEAST_LOOP)
    return [np.flatnonzero(labels == label) for label in large]


def _longest_path(positions: NDArray[np.float64], reach: float) -> NDArray[np.int64]:
    """Longest path of the minimum spanning tree: that of a loop is the loop cut open, with short branches."""
    pairs = cKDTree(positions).query_pairs(reach, output_type="ndarray")
    if len(pairs) == 0:
        return np.arange(len(positions))[:1]
    lengths = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    lengths = np.maximum(lengths, 1e-12 * reach)  # SciPy takes a zero for a missing edge
    tree = minimum_spanning_tree(coo_array((lengths, pairs.T), shape=(len(positions),) * 2).tocsr())
    end = breadth_first_order(tree, 0, directed=False)[0][-1]
    order, parents = breadth_first_order(tree, end, directed=False)
    path = [int(order[-1])]
    while path[-1] != end:
        path.append(int(parents[path[-1]]))
    return np.array(path)


def _measure(
    path: NDArray[np.int64], positions: NDArray[np.float64], normals: NDArray[np.float64], spacing: float
) -> BoundaryCurve:
    """Length and turning of the closed polygon through `path`, smoothed over about two and a half spacings."""
    nearby = cKDTree(positions).query(positions[path], min(20, len(positions)))[1]
    up = normals[path]
    up = up * np.where((up * np.roll(up, 1, axis=0)).sum(1) < 0, -1.0, 1.0).cumprod()[:, None]
    steps = np.linalg.norm(np.roll(positions[path], -1, axis=0) - positions[path], axis=1)
    width = max(2, round(2.5 * spacing / max(steps.mean(), 1e-300)))
    curve = _smoothed(positions[path], width)
    up = _smoothed(up, width)
    up = normalize(torch.from_numpy(up)).numpy()
    inward = _smoothed(positions[nearby].mean(1) - positions[path], width)
    ahead = np.roll(curve, -1, axis=0) - curve
    behind = curve - np.roll(curve, 1, axis=0)
    ahead, behind = (side - (side * up).sum(1, keepdims=True) * up for side in (ahead, behind))
    angle = np.arctan2((np.cross(behind, ahead) * up).sum(1), (behind * ahead).sum(1))
    side = np.sign((np.cross(up, behind + ahead) * inward).sum())  # +1 if the surface lies to the left
    return BoundaryCurve(torch.from_numpy(path), float(np.linalg.norm(ahead, axis=1).sum()), float(side * angle.sum()))


def _smoothed(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Three running means around the closed curve."""
    half = min(width, (len(values) - 1) // 2)
    kernel = np.ones(2 * half + 1) / (2 * half + 1)
    for _ in range(3):
        padded = np.concatenate((values[-half:], values, values[:half])) if half else values
        values = np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=1)
    return values
