"""Euler characteristics of the winding-number fields of oriented samples, on grids as fine as the samples.

A cloud of moderate extent is covered by one grid for each setting. Where all of these are coarser than the samples, as
around parts that lie far from each other, every part that is apart from the others gets a grid of its own: outside a
closed surface its winding number is zero, so fields of parts add up, and so do their Euler characteristics.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from topokit.core.cloud.neighborhoods import FEWEST_POINTS
from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import Grid, make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.core.labels import compact_labels, connected_labels

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Task = Callable[[], list[tuple[int, int]]]

FIELD_SETTINGS = ((1.5, 1.5, 128**3), (2.0, 1.5, 160**3), (2.0, 2.5, 160**3))
"""Cells per sample spacing, Gaussian smoothing in cells, largest number of grid vertices."""

_MOST_VERTICES = 40_000_000  # of all grids of the parts: 2 seconds and 0.8 GB for each setting
_APART = 4.0  # sample spacings between the boxes of parts that get grids of their own
_MOST_PARTS = 256  # that may lie apart; of more, each a stray piece, the boxes are not compared


@dataclass(frozen=True, eq=False)
class _Layer:
    """Oriented samples in single precision: points (N, 3), outward unit normals (N, 3), areas (N,)."""

    points: Tensor
    normals: Tensor
    areas: Tensor

    def at(self, rows: Integers) -> _Layer:
        index = torch.from_numpy(rows)
        return _Layer(self.points[index], self.normals[index], self.areas[index])

    def euler(self, grid: Grid, sigma: float) -> int:
        """Euler characteristic of the level set of the field on a grid, smoothed over `sigma` cells."""
        field = winding_field(self.points, self.normals, self.areas, grid, sigma)
        return int(surface_euler(field.values, 0.5, connectivity=6))


def field_tasks(
    points: Floats, normals: Floats, areas: Floats, spacing: float, parts: Callable[[], Integers]
) -> Sequence[Task]:
    """What finds the Euler characteristic of each field that is fine enough: tasks for threads.

    Args:
        points: (N, 3).
        normals: (N, 3), unit, outward.
        areas: (N,), surface area that each point stands for.
        spacing: of the finest samples; no cell is larger.
        parts: returns the number (N,) of the connected part that each point belongs to.

    Returns:
        Functions that return pairs of a setting's index and the Euler characteristic of the surface.
    """
    layer = _Layer(*(torch.as_tensor(values, dtype=torch.float32) for values in (points, normals, areas)))
    grids = [make_grid(layer.points, spacing, cells, most) for cells, _, most in FIELD_SETTINGS]
    tasks = [partial(_on_grid, layer, grid, k) for k, grid in enumerate(grids) if grid.cell <= spacing]
    return tasks or [partial(_on_grids_of_parts, layer, points, spacing, parts)]


def _on_grid(layer: _Layer, grid: Grid, setting: int) -> list[tuple[int, int]]:
    return [(setting, layer.euler(grid, FIELD_SETTINGS[setting][1]))]


def _on_grids_of_parts(
    layer: _Layer, points: Floats, spacing: float, parts: Callable[[], Integers]
) -> list[tuple[int, int]]:
    """The same on grids of one cell per spacing; nothing if they have too many vertices or too large cells."""
    labels = parts_apart(points, parts(), _APART * spacing)
    order = np.argsort(labels, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(labels))[:-1])
    layers = [layer.at(rows) for rows in groups if len(rows) >= FEWEST_POINTS]  # fewer bound nothing
    grids = [make_grid(one.points, spacing, 1.0, _MOST_VERTICES) for one in layers]
    if sum(grid.n_vertices for grid in grids) > _MOST_VERTICES or any(grid.cell > spacing for grid in grids):
        return []
    smoothings = [sigma / cells * spacing for cells, sigma, _ in FIELD_SETTINGS]  # in units of length
    return [
        (setting, sum(one.euler(grid, length / grid.cell) for one, grid in zip(layers, grids, strict=True)))
        for setting, length in enumerate(smoothings)
    ]


def parts_apart(points: Floats, parts: Integers, distance: float) -> Integers:
    """Numbers 0, 1, … (N,) of groups of parts whose bounding boxes are farther than a distance from each other.

    Args:
        points: (N, 3).
        parts: (N,), the connected part of each point.
        distance: between boxes of different groups, at least, along some axis.
    """
    groups = compact_labels(parts, int(parts.max()) + 1)
    if groups.max() >= _MOST_PARTS:
        return np.zeros_like(groups)
    while True:
        low, high = _boxes(points, groups)
        is_near = ((low[:, None] <= high + distance) & (low <= high[:, None] + distance)).all(2)
        joined = connected_labels(len(low), *np.nonzero(is_near))
        if joined.max() + 1 == len(low):
            return groups
        groups = joined[groups]


def _boxes(points: Floats, labels: Integers) -> tuple[Floats, Floats]:
    """Lowest and highest corners (M, 3) of the points with each label."""
    order = np.argsort(labels, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(labels))[:-1])
    return np.minimum.reduceat(points[order], starts), np.maximum.reduceat(points[order], starts)
