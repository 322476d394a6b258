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
from torch import Tensor

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.settings import FieldSettings
from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import Grid, make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.core.labels import compact_labels, connected_labels

Task = Callable[[], list[tuple[int, int]]]

MOST_PARTS = 256
"""Parts that may lie apart: of more, each is a stray piece, and none get grids of their own."""


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
    points: Floats,
    normals: Floats,
    areas: Floats,
    spacing: float,
    parts: Callable[[], Integers],
    settings: FieldSettings,
) -> Sequence[Task]:
    """What finds the Euler characteristic of each field that is fine enough: tasks for threads.

    Args:
        points: (N, 3).
        normals: (N, 3), unit, outward.
        areas: (N,), surface area that each point stands for.
        spacing: of the finest samples; no cell is larger.
        parts: returns the number (N,) of the connected part that each point belongs to.
        settings: of the grids.

    Returns:
        Functions that return pairs of a setting's index and the Euler characteristic of the surface.
    """
    layer = _Layer(*(torch.as_tensor(values, dtype=torch.float32) for values in (points, normals, areas)))
    grids = [make_grid(layer.points, spacing, cells, most) for cells, _, most in settings.grids]
    tasks = [partial(_on_grid, layer, grid, k, settings) for k, grid in enumerate(grids) if grid.cell <= spacing]
    return tasks or [partial(_on_grids_of_parts, layer, points, spacing, parts, settings)]


def _on_grid(layer: _Layer, grid: Grid, setting: int, settings: FieldSettings) -> list[tuple[int, int]]:
    return [(setting, layer.euler(grid, settings.grids[setting][1]))]


def _on_grids_of_parts(
    layer: _Layer, points: Floats, spacing: float, parts: Callable[[], Integers], settings: FieldSettings
) -> list[tuple[int, int]]:
    """The same on grids of one cell per spacing; nothing if they have too many vertices or too large cells."""
    labels = parts_apart(points, parts(), MOST_PARTS)
    order = np.argsort(labels, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(labels))[:-1])
    layers = [layer.at(rows) for rows in groups if len(rows) >= FEWEST_POINTS]  # fewer bound nothing
    most = sum(size for _, _, size in settings.grids)  # as many as all grids of a cloud in one piece have
    grids = [make_grid(one.points, spacing, 1.0, most) for one in layers]
    n_vertices = sum(grid.n_vertices for grid in grids)
    if n_vertices > most or any(grid.cell > spacing for grid in grids):
        return []
    smoothings = [sigma / cells * spacing for cells, sigma, _ in settings.grids]  # in units of length
    return [
        (setting, sum(one.euler(grid, length / grid.cell) for one, grid in zip(layers, grids, strict=True)))
        for setting, length in enumerate(smoothings)
    ]


def parts_apart(points: Floats, parts: Integers, most: int) -> Integers:
    """Numbers 0, 1, … (N,) of groups of parts whose bounding boxes do not meet.

    Args:
        points: (N, 3).
        parts: (N,), the connected part of each point.
        most: number of parts from which they are not told apart: most of so many are stray pieces.
    """
    groups = compact_labels(parts, int(parts.max()) + 1)
    if groups.max() >= most:
        return np.zeros_like(groups)
    while True:
        low, high = _boxes(points, groups)
        is_near = ((low[:, None] <= high) & (low <= high[:, None])).all(2)
        joined = connected_labels(len(low), *np.nonzero(is_near))
        if joined.max() + 1 == len(low):
            return groups
        groups = joined[groups]


def _boxes(points: Floats, labels: Integers) -> tuple[Floats, Floats]:
    """Lowest and highest corners (M, 3) of the points with each label."""
    order = np.argsort(labels, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(labels))[:-1])
    return np.minimum.reduceat(points[order], starts), np.maximum.reduceat(points[order], starts)
