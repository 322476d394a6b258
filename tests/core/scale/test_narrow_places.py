"""Narrow places: each kind is found where it was made, as wide as it was made, and nothing else is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from skimage.measure import marching_cubes
from trimesh.creation import annulus, box, icosphere

from topokit.core.scale.narrow_places import NarrowPlace, missed_places, narrow_places
from topokit.core.scale.signed_distance import signed_distance
from topokit.core.surface import TriangleSurface

pytest.importorskip("cripser", reason="cripser is not installed; it has no wheels for this machine")

BELOW = 0.15


def joined(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(meshes)


def moved(mesh: trimesh.Trimesh, *place: float) -> trimesh.Trimesh:
    return mesh.apply_translation(place)


def inverted(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    mesh.invert()
    return mesh


def level_mesh(function: Callable[..., np.ndarray]) -> trimesh.Trimesh:
    """The zero set of a function of x, y and z, negative inside, in a cube of side two."""
    axis = np.linspace(-1, 1, 97)
    values = function(*np.meshgrid(axis, axis, axis, indexing="ij"))
    vertices, faces, _, _ = marching_cubes(-values, 0.0)
    return trimesh.Trimesh(vertices / 48 - 1, faces[:, ::-1])


def dumbbell() -> trimesh.Trimesh:
    def distance(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        ends = np.sqrt(x**2 + y**2 + (np.abs(z) - 0.5) ** 2) - 0.3
        return np.minimum(ends, np.maximum(np.hypot(x, y) - 0.05, np.abs(z) - 0.5))

    return level_mesh(distance)


def almost_a_ring() -> trimesh.Trimesh:
    sides = [moved(box((0.2, 0.2, 1.0)), x, 0, 0) for x in (-0.4, 0.4)]
    arms = [moved(box((0.4, 0.2, 0.2)), x, 0, 0.4) for x in (-0.25, 0.25)]  # with a gap of 0.1 between them
    return joined(*sides, moved(box((1.0, 0.2, 0.2)), 0, 0, -0.4), *arms)


def almost_a_tunnel() -> trimesh.Trimesh:
    def distance(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        radius = np.hypot(x, y)
        tube = np.maximum(np.abs(radius - 0.35) - 0.1, np.abs(z) - 0.5)
        return np.minimum(tube, np.maximum(radius - 0.3, np.abs(z) - 0.05))

    return level_mesh(distance)


SHAPES = {
    "thin part": (lambda: joined(icosphere(4, 0.4), moved(icosphere(3, 0.05), 0.8, 0, 0)), 0.1, (0.8, 0, 0), -2),
    "thin neck": (dumbbell, 0.1, (0, 0, None), 2),
    "thin membrane": (almost_a_tunnel, 0.1, (None, None, 0), -2),
    "thin wall": (lambda: joined(icosphere(4, 0.5), inverted(icosphere(4, 0.4))), 0.1, None, -2),
    "thin handle": (lambda: trimesh.creation.torus(0.5, 0.06, 96, 32), 0.12, None, 2),
    "narrow tunnel": (lambda: annulus(0.06, 0.4, 0.5, sections=64), 0.12, (0, 0, None), 2),
    "small cavity": (lambda: joined(icosphere(4, 0.5), inverted(icosphere(3, 0.06))), 0.12, (0, 0, 0), -2),
}


def found_in(mesh: trimesh.Trimesh, below: float = BELOW) -> tuple[NarrowPlace, ...]:
    surface = TriangleSurface(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64))
    return narrow_places(signed_distance(surface, below / 6), below)


@pytest.mark.parametrize("kind", SHAPES)
def test_each_kind_is_found_alone(kind: str) -> None:
    make, width, place, change = SHAPES[kind]
    [found, *more] = found_in(make())
    assert [one.kind for one in more] in ([], ["thin part"])  # the whole part may be as thin
    assert (found.kind, found.change, found.votes) == (kind, change, None)
    assert found.width == pytest.approx(width, rel=0.1)
    for measured, known in zip(found.place, place or (), strict=False):
        assert known is None or abs(measured - known) < 0.05


def test_a_gap_that_would_close_to_a_ring() -> None:
    [found] = found_in(almost_a_ring())
    assert (found.kind, found.change) == ("narrow gap", -2)
    assert found.width == pytest.approx(0.1, rel=0.1)
    assert np.abs(np.subtract(found.place, (0, 0, 0.4))).max() < 0.15


def test_a_gap_between_parts() -> None:
    [found] = found_in(joined(box((0.8, 0.8, 0.8)), moved(box((0.6, 0.6, 0.6)), 0.8, 0, 0)))
    assert (found.kind, found.change) == ("narrow gap", -2)
    assert found.width == pytest.approx(0.1, rel=0.1)


def test_a_stout_shape_has_none() -> None:
    assert found_in(icosphere(4, 0.5)) == ()
    assert found_in(trimesh.creation.torus(0.5, 0.2, 96, 48)) == ()


def test_narrowest_first() -> None:
    holes = [moved(annulus(radius, 0.25, 0.3, sections=64), 0.44 * number, 0, 0) for number, radius in enumerate(WIDE)]
    widths = [one.width for one in found_in(joined(*holes)) if one.kind == "narrow tunnel"]
    np.testing.assert_allclose(widths, sorted(2 * radius for radius in WIDE if 2 * radius <= BELOW), rtol=0.1)


WIDE = (0.06, 0.04, 0.12)


def test_samples_off_the_surface_are_one_place_where_several_are_near_each_other() -> None:
    row = np.linspace((0, 0, 0), (0.4, 0, 0), 5)
    alone, pair = np.array([[9.0, 9, 9]]), np.array([[5.0, 5, 5], [5, 5, 5.1]])
    [found] = missed_places(np.concatenate((alone, row, pair)), 0.11)
    assert (found.kind, found.change) == ("missed samples", None)
    assert found.width == pytest.approx(0.4)
    assert found.place == pytest.approx((0.2, 0, 0))
    assert missed_places(np.empty((0, 3)), 1.0) == ()
