"""Widths of features: those of solids whose widths are known, stability under noise, and the signed distance itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from topokit.core.scale.features import CELLS_PER_WIDTH, SolidCounts, SolidFeatures, solid_features
from topokit.core.scale.signed_distance import SignedDistance, signed_distance
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError

pytest.importorskip("cripser", reason="cripser is not installed; it has no wheels for this machine")


BALL = SolidCounts(1, 0, 0)


def surface_of(mesh: trimesh.Trimesh) -> TriangleSurface:
    return TriangleSurface(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64))


def turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1, 2, 3)))


def hollow(outer: float, inner: float) -> trimesh.Trimesh:
    cavity = trimesh.creation.icosphere(4, inner)
    cavity.invert()
    return trimesh.util.concatenate([trimesh.creation.icosphere(4, outer), cavity])


def features_of(mesh: trimesh.Trimesh, finest: float, counts: SolidCounts = BALL) -> SolidFeatures:
    surface = surface_of(mesh)
    found = solid_features(signed_distance(surface, finest / CELLS_PER_WIDTH))
    return SolidFeatures(found, finest, counts, 0.0)


def test_a_ball_is_one_part_as_thick_as_it_is() -> None:
    [part] = features_of(turned(trimesh.creation.icosphere(4, 0.5)), 0.1).features
    assert (part.kind, part.opening) == ("part", math.inf)
    assert part.width == part.thickness == pytest.approx(1.0, rel=0.02)
    assert np.linalg.norm(part.place) < 0.05


def test_a_torus_has_a_handle_and_a_tunnel() -> None:
    mesh = turned(trimesh.creation.torus(1.0, 0.3, major_sections=100, minor_sections=50))
    found = features_of(mesh, 0.15)
    part, tunnel = sorted(found.features, key=lambda one: one.kind)
    assert (part.kind, tunnel.kind) == ("part", "tunnel")
    assert tunnel.thickness == pytest.approx(0.6, rel=0.05)
    assert tunnel.opening == pytest.approx(1.4, rel=0.05)
    assert np.linalg.norm(tunnel.place) < 0.1  # in the middle of the hole
    assert abs(np.linalg.norm(tunnel.at_thickness) - 1) < 0.1  # on the center line
    assert found.above(0.5).euler == 0
    assert found.above(0.7) == (0, 0, 0)  # no ball that wide is inside


def test_a_hollow_ball_has_a_cavity_and_a_wall() -> None:
    found = features_of(hollow(0.6, 0.4), 0.06)
    cavity = next(one for one in found.features if one.kind == "cavity")
    assert cavity.thickness == pytest.approx(0.2, rel=0.08)
    assert cavity.opening == pytest.approx(0.8, rel=0.02)
    assert (found.above(0.1), found.above(0.1).euler, found.above(0.1).components) == ((1, 0, 1), 4, 2)


def test_a_gap_between_parts_is_the_opening_of_the_thinner_one() -> None:
    small = trimesh.creation.icosphere(3, 0.2).apply_translation((0.0, 0.0, 0.9))
    found = features_of(turned(trimesh.util.concatenate([trimesh.creation.icosphere(4, 0.5), small])), 0.08)
    thin, thick = found.features
    assert thin.width == thin.opening == pytest.approx(0.2, rel=0.08)
    assert thin.thickness == pytest.approx(0.4, rel=0.05)
    assert thick.opening == math.inf


def test_parts_that_overlap_are_one_solid() -> None:
    other = trimesh.creation.icosphere(4, 0.5).apply_translation((0.4, 0.0, 0.0))
    both = trimesh.util.concatenate([trimesh.creation.icosphere(4, 0.5), other])
    assert features_of(both, 0.08).above(0.1) == (1, 0, 0)


@pytest.mark.parametrize("seed", range(3))
def test_holes_of_a_plate_are_found_from_three_cells_on(seed: int) -> None:
    radii = np.sort(np.exp(np.random.default_rng(seed).uniform(np.log(0.03), np.log(0.14), 4)))
    plate = [  # of rings that overlap their neighbors but not the holes of these: the winding number joins them
        trimesh.creation.annulus(radius, 0.25, 0.3, sections=64).apply_translation((0.44 * number, 0.0, 0.0))
        for number, radius in enumerate(radii)
    ]
    found = features_of(turned(trimesh.util.concatenate(plate)), 0.045)
    widths = sorted(one.opening for one in found.features if one.kind == "tunnel")
    np.testing.assert_allclose(widths, 2 * radii, rtol=0.1)


def test_widths_change_by_no_more_than_the_surface() -> None:
    mesh = trimesh.creation.torus(1.0, 0.3, major_sections=100, minor_sections=50)
    noise, rng = 0.02, np.random.default_rng(0)
    moved = mesh.copy()
    moved.vertices += noise * (2 * rng.random((len(mesh.vertices), 1)) - 1) * mesh.vertex_normals
    before, after = (features_of(one, 0.12).features for one in (mesh, moved))
    assert [one.kind for one in before] == [one.kind for one in after]
    for one, other in zip(before, after, strict=True):
        assert abs(one.width - other.width) <= 2 * noise + 0.02


def test_narrower_features_are_counted_together() -> None:
    found = features_of(hollow(0.6, 0.55), 0.2, SolidCounts(1, 0, 1))  # the wall is thinner than the grid can see
    assert [a + b for a, b in zip(found.above(0.2), found.narrower, strict=True)] == [1, 0, 1]
    with pytest.raises(InputError, match=r"from a width of 0.2 on.*above=0.1\)"):
        found.above(0.1)


def test_the_curve_ends_with_the_widest_feature() -> None:
    found = features_of(hollow(0.6, 0.4), 0.06)
    assert [euler for _, euler in found.curve()] == [4, 2]
    [(start, _), (wall, _)] = found.curve()
    assert (start, wall) == (0.06, pytest.approx(0.2, rel=0.08))


def test_signed_distance_of_a_box() -> None:
    low, high = np.array([-0.5, -0.3, -0.2]), np.array([0.5, 0.3, 0.2])
    found = signed_distance(surface_of(trimesh.creation.box(high - low)), 0.05)
    index = np.stack(np.meshgrid(*map(np.arange, found.values.shape), indexing="ij"), -1)
    place = found.place(index)
    beyond = np.maximum(np.maximum(low - place, place - high), 0)
    true = np.linalg.norm(beyond, axis=-1) + np.minimum(np.maximum(low - place, place - high).max(-1), 0)
    assert ((found.values < 0) == (true < 0)).all()
    assert np.abs(found.values - true).max() < 0.05


def test_a_surface_that_is_not_closed_is_refused() -> None:
    mesh = trimesh.creation.icosphere(3)
    with pytest.raises(InputError, match="not closed"):
        signed_distance(TriangleSurface(np.asarray(mesh.vertices), np.asarray(mesh.faces[:-400])), 0.1)


def test_the_same_features_whatever_the_units() -> None:
    mesh = trimesh.creation.torus(1.0, 0.3, major_sections=60, minor_sections=30)
    usual = features_of(mesh, 0.15).features
    for scale in (1e-6, 1e6):
        for one, other in zip(usual, features_of(mesh.copy().apply_scale(scale), 0.15 * scale).features, strict=True):
            assert other.width == pytest.approx(scale * one.width, rel=1e-3)
    assert isinstance(signed_distance(surface_of(mesh), 0.1), SignedDistance)
