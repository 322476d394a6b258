"""Winding-number fields of parts that lie apart, on grids as fine as the samples."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from topokit.core.cloud.fields import MOST_PARTS, field_tasks, parts_apart
from topokit.core.cloud.settings import CloudSettings, FieldSettings, SamplingSettings
from topokit.core.cloud.votes import values_of
from topokit.core.cloud.witness import global_witness
from topokit.testing import sphere_samples, torus_samples

SETTINGS = FieldSettings()
SPHERE, TORUS = sphere_samples(800), torus_samples(1500)


def row_of(count: int, distance: float, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Copies of a part along an axis, and the number of the part of each point."""
    moved = [points + np.array([distance * k, 0.0, 0.0]) for k in range(count)]
    return np.concatenate(moved), np.repeat(np.arange(count), len(points))


def eulers(
    points: np.ndarray,
    normals: np.ndarray,
    area: float,
    spacing: float,
    parts: np.ndarray,
    settings: FieldSettings = SETTINGS,
) -> list[int]:
    areas = np.full(len(points), area / len(points))
    tasks = field_tasks(points, normals, areas, spacing, lambda: parts, settings)
    found = [pair for task in tasks for pair in task()]
    assert [setting for setting, _ in found] == sorted({setting for setting, _ in found})
    return [euler for _, euler in found]


@pytest.mark.parametrize(("known", "euler"), [(SPHERE, 2), (TORUS, 0)], ids=["spheres", "tori"])
def test_fields_of_distant_parts_add_up(known: object, euler: int) -> None:
    count = 4
    points, parts = row_of(count, 80.0, known.points.numpy())  # type: ignore[attr-defined]
    normals = np.tile(known.normals.numpy(), (count, 1))  # type: ignore[attr-defined]
    area = count * known.area  # type: ignore[attr-defined]
    spacing = float(np.sqrt(area / len(points)))
    assert eulers(points, normals, area, spacing, parts) == [count * euler] * len(SETTINGS.grids)


def test_fields_on_too_large_grids_do_not_vote() -> None:
    points, _ = row_of(2, 80.0, SPHERE.points.numpy())
    normals = np.tile(SPHERE.normals.numpy(), (2, 1))
    one_part = np.zeros(len(points), dtype=np.int64)
    assert eulers(points, normals, 2 * SPHERE.area, 0.02, one_part) == []
    spacing = (SPHERE.area / 800) ** 0.5
    near, parts = row_of(2, 80.0, SPHERE.points.numpy())
    assert eulers(near, normals, 2 * SPHERE.area, spacing, parts) == [4, 4, 4]
    small = FieldSettings(grids=tuple((*grid[:2], 20_000 // 3) for grid in SETTINGS.grids))  # as many together
    assert eulers(near, normals, 2 * SPHERE.area, spacing, parts, small) == []


def test_one_grid_has_the_cells_and_smoothing_of_its_setting() -> None:
    points, parts = TORUS.points.numpy(), np.zeros(1500, dtype=np.int64)
    spacing = (TORUS.area / 1500) ** 0.5
    one = FieldSettings(grids=((2.0, 1.5, 64**3),))
    assert eulers(points, TORUS.normals.numpy(), TORUS.area, spacing, parts, one) == [0]
    blurred = FieldSettings(grids=((2.0, 12.0, 64**3),))  # over six spacings, more than the hole has
    assert eulers(points, TORUS.normals.numpy(), TORUS.area, spacing, parts, blurred) != [0]


def test_parts_within_each_other_share_a_grid() -> None:
    inner, outer, far = SPHERE.points.numpy(), 3 * SPHERE.points.numpy(), SPHERE.points.numpy() + 20.0
    points, parts = np.concatenate((inner, far, outer)), np.repeat([7, 3, 5], len(inner))
    groups = parts_apart(points, parts, MOST_PARTS)
    assert groups[0] == groups[-1] != groups[len(inner)]
    near = np.where(parts[:, None] == 3, points - 17.0, points)  # its box meets the outer one's
    assert set(parts_apart(near, parts, MOST_PARTS)) == {0}
    assert len(set(parts_apart(points, np.arange(len(points)), MOST_PARTS))) == 1  # each a stray point
    assert set(parts_apart(points, parts, most=2)) == {0}


def test_many_distant_parts_of_a_large_cloud_have_field_votes() -> None:
    settings = CloudSettings(sampling=SamplingSettings(whole=3000, samples=2000))
    points, _ = row_of(6, 60.0, sphere_samples(1000).points.numpy())
    found = global_witness(torch.from_numpy(points), settings=settings)
    assert (found.euler, found.components, found.preparation) == (12, 6, "sampled")
    assert values_of(found.votes, "field") == [12, 12, 12]
