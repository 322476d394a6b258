"""Widths at voxels, for which the surface is made around them only."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

import topokit as tk
from topokit.adapters.voxels.field import VoxelField
from topokit.core.scale.widths import SurfaceWidths

SPACING = (1.0, 1.0, 1.5)
NONE = np.empty((0, 3), dtype=np.int64)


def test_of_a_plate_and_the_gap_beside_it() -> None:
    volume = torch.zeros((40, 40, 70), dtype=torch.bool)
    volume[:, :, 10:14] = volume[:, :, 20:60] = True
    shape = tk.from_voxels(volume)
    assert isinstance(shape.field, VoxelField)
    widths = SurfaceWidths(partial(shape.field.surface_in_boxes, flipped=NONE), (1.0, 1.0, 1.0), 8.0)
    plate, gap, thick = widths.at(np.array([[20, 20, 12], [20, 20, 17], [20, 20, 40]]))
    assert plate == pytest.approx(4, abs=0.6)
    assert gap == pytest.approx(6, abs=0.6)
    assert thick >= 8


def test_by_boxes_they_are_those_of_the_whole_surface() -> None:
    volume = gaussian_filter(np.random.default_rng(2).normal(size=(40, 20, 22)), 2)
    shape = tk.from_voxels(volume, level=0.0, spacing=SPACING)
    assert isinstance(shape.field, VoxelField)
    voxels = np.random.default_rng(3).integers(0, volume.shape, (200, 3))
    surface = shape.field.surface()
    corners = surface.vertices[surface.faces]
    edges = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    tree = cKDTree(np.concatenate((surface.vertices, corners.mean(axis=1), edges)))
    around = np.stack(np.meshgrid(*[np.arange(-2, 3) / 4] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    whole = 2 * tree.query((voxels[:, None] + around) * SPACING)[0].max(axis=1)
    found = SurfaceWidths(partial(shape.field.surface_in_boxes, flipped=NONE), SPACING, 4.0).at(voxels)
    is_narrow = whole < 4
    assert 50 < is_narrow.sum() < 200
    assert found[is_narrow] == pytest.approx(whole[is_narrow], abs=1e-6)
    assert (found[~is_narrow] >= 4).all()
