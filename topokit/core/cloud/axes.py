"""Axes, areas and noise of every point of a large cloud, from neighborhoods of all its points."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.linalg import smallest_eigenvector

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]

_NEIGHBORS = 10  # neighbors for planes: few, so that sheets that are close together are not mixed
_GRAPH = 8  # neighbors that are kept for the graph, and of the disc whose area a point stands for
_ROWS = 1 << 12  # points whose neighborhoods are in memory, and in the processor's cache, at once


@dataclass(frozen=True, eq=False)
class SurfaceAxes:
    """What the neighborhoods of N points say.

    Attributes:
        tree: the tree of the points.
        neighbors: (N, 8), nearest first, without the point itself.
        axes: (N, 3), unit normals of arbitrary sign (PCA).
        areas: (N,), surface area that each point stands for.
        thickness: (N,), root-mean-square distance of the neighbors from the fitted plane.
        roughness: median ratio of the thickness to the radius of the neighborhood.
    """

    tree: cKDTree
    neighbors: Integers
    axes: Floats
    areas: Floats
    thickness: Floats
    roughness: float

    @property
    def noise(self) -> float:
        """Standard deviation of the points from the surface, at most: bending counts, too."""
        return float(np.median(self.thickness))


def surface_axes(points: Floats) -> SurfaceAxes:
    """Axes, areas and thickness at all points; blocks of points on all processors, so memory is bounded.

    Args:
        points: (N, 3), distinct, more than ten.
    """
    tree = cKDTree(points, balanced_tree=False)  # compact nodes pay where all points are looked up
    order = tree.indices  # neighboring queries share their way down the tree
    count = len(points)
    neighbors = np.empty((count, _GRAPH), dtype=np.int32)
    axes, radius, thickness = np.empty((count, 3)), np.empty(count), np.empty(count)

    def measure(start: int) -> None:
        rows = order[start : start + _ROWS]
        distance, index = tree.query(points[rows], _NEIGHBORS + 1)
        neighbors[rows] = index[:, 1 : _GRAPH + 1]
        radius[rows] = distance[:, _GRAPH]
        axes[rows], thickness[rows] = plane_axes(points.take(index, axis=0))

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        list(threads.map(measure, range(0, count, _ROWS)))
    roughness = float(np.median(thickness / np.maximum(radius, 1e-300)))
    return SurfaceAxes(tree, neighbors, axes, np.pi * radius**2 / _GRAPH, thickness, roughness)


def plane_axes(patches: Floats) -> tuple[Floats, Floats]:
    """Unit normals (n, 3) of arbitrary sign of planes fitted to patches (n, k, 3), and distances from them (n,)."""
    patches = patches - patches.mean(1, keepdims=True)
    moments = patches.transpose(0, 2, 1) @ patches
    size = np.maximum(np.trace(moments, axis1=1, axis2=2), np.finfo(np.float64).tiny)
    scaled = torch.from_numpy(moments / size[:, None, None])
    axes = smallest_eigenvector(scaled, scaled[:, 0]).numpy()
    height = np.einsum("nka,na->nk", patches, axes)
    return axes, np.sqrt(np.einsum("nk,nk->n", height, height) / patches.shape[1])
