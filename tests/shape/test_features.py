"""Features by width of every representation, and what reports, genus and the command line say of them."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

import topokit as tk
from topokit.batch.widths import width_values
from topokit.core.scale.features import SolidCounts
from topokit.testing import genus_mesh, torus_mesh, torus_samples
from topokit.testing.surfaces import sphere_samples

pytest.importorskip("cripser", reason="cripser is not installed; it has no wheels for this machine")

MAJOR, MINOR = 1.0, 0.35


def torus_field() -> tk.Shape:
    return tk.from_sdf(
        lambda p: torch.hypot(p[:, :2].norm(dim=1) - MAJOR, p[:, 2]) - MINOR, bounds=(-1.5, 1.5), resolution=128
    )


def torus_volume() -> tk.Shape:
    x, y, z = torch.meshgrid(*[torch.linspace(-1.5, 1.5, 61)] * 3, indexing="ij")
    return tk.from_voxels(torch.hypot(torch.hypot(x, y) - MAJOR, z) < MINOR, spacing=0.05, origin=(-1.5,) * 3)


REPRESENTATIONS = {
    "mesh": lambda: tk.from_mesh(torus_mesh(100, 50, MAJOR, MINOR)),
    "points": lambda: tk.from_points(torus_samples(2500, MAJOR, MINOR).points),
    "volume": torus_volume,
    "function": torus_field,
}


@cache
def torus(representation: str) -> tk.Shape:
    return REPRESENTATIONS[representation]()


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_every_representation_has_the_same_widths(representation: str) -> None:
    found = torus(representation).features(above=0.2)
    assert sorted(one.kind for one in found.features) == ["part", "tunnel"]
    tunnel = next(one for one in found.features if one.kind == "tunnel")
    assert tunnel.thickness == pytest.approx(2 * MINOR, rel=0.12)
    assert tunnel.opening == pytest.approx(2 * (MAJOR - MINOR), rel=0.12)
    assert found.narrower == (0, 0, 0)


def test_genus_above_a_width() -> None:
    shape = torus("mesh")
    assert (shape.genus(), shape.genus(above=0.5), shape.genus(above=0.8)) == (1, 1, 0)


def test_a_report_with_features() -> None:
    report = tk.report(torus("mesh"), features=0.3)
    assert report.above(0.5).euler == report.euler == 0
    assert "At least 0.3 wide: 1 part, 1 tunnel, 0 cavities (χ 0)." in report.text()
    assert re.search(r"Tunnel: 1\.[23]\d* wide, its handle 0\.(6|7)\d* thick, at \(", report.text())
    rows = json.loads(report.to_json())["features"]["features"]
    assert {row["kind"] for row in rows} == {"part", "tunnel"}
    assert next(row for row in rows if row["kind"] == "part")["opening"] is None  # infinite
    assert "<polyline" in report._repr_html_()


def test_without_features_nothing_is_above() -> None:
    report = tk.from_mesh(torus_mesh()).report()
    assert report.features is None
    with pytest.raises(tk.InputError, match=r"report\(features=True\)"):
        report.above(0.1)


def test_a_tunnel_and_a_part_that_cancel_in_the_integer_are_both_found() -> None:
    bar, ring = trimesh.creation.box((2.0, 0.1, 0.1)), trimesh.creation.torus(0.025, 0.0125)
    found = tk.from_mesh(trimesh.util.concatenate([bar, ring.apply_translation((0.3, 0.15, 0.0))])).features()
    assert (found.narrower, found.counts) == ((0, 0, 0), (2, 1, 0))
    assert sorted(one.kind for one in found.features) == ["part", "part", "tunnel"]


def test_the_narrowest_feature_is_unknown_if_the_grid_cannot_show_it() -> None:
    report = tk.from_mesh(torus_mesh()).report(features=True)
    assert width_values(report, True)["narrowest_cavity"] == math.inf
    drilled = replace(report, features=replace(report.features, counts=SolidCounts(1, 2, 0)))
    assert width_values(drilled, True)["narrowest_tunnel"] is None
    assert "narrower: 1 tunnel" in drilled.text()


def test_by_default_the_grid_is_as_fine_as_what_is_counted() -> None:
    bar, speck = trimesh.creation.box((2.0, 0.1, 0.1)), trimesh.creation.icosphere(3, 0.0125)
    found = tk.from_mesh(trimesh.util.concatenate([bar, speck.apply_translation((0.3, 0.1, 0.0))])).features()
    assert (found.narrower, len(found.features)) == ((0, 0, 0), 2)
    assert found.finest < 3 / 128 * 2 / 2
    assert found.features[0].width == pytest.approx(0.025, rel=0.1)


def test_points_are_measured_from_their_resolution_on() -> None:
    shape = tk.from_points(sphere_samples(1000).points)
    found, resolution = shape.features(), shape.report().resolution
    assert found.finest == resolution
    assert [one.kind for one in found.features] == ["part"]
    assert found.features[0].opening == math.inf


@pytest.mark.parametrize("finest", [0.0, -1.0, math.nan])
def test_a_width_must_be_positive(finest: float) -> None:
    with pytest.raises(tk.InputError, match="positive width"):
        tk.from_mesh(torus_mesh()).features(finest)


def test_too_fine_a_grid_is_refused() -> None:
    with pytest.raises(tk.InputError, match="ask for those from"):
        tk.from_mesh(genus_mesh(2)).features(1e-6)


def test_an_open_mesh_has_no_features_and_a_report_says_why() -> None:
    mesh = trimesh.creation.box()
    mesh.update_faces([True] * 10 + [False] * 2)
    with pytest.raises(tk.InputError, match="no closed surface"):
        tk.from_mesh(mesh).features()
    assert "Widths of features were not measured" in tk.report(mesh, features=True).text(full=True)


@pytest.mark.parametrize("representation", ["mesh", "points"])
def test_narrow_places(representation: str) -> None:
    handle, part = torus(representation).narrow_places(below=0.9)
    assert (handle.kind, handle.change, part.kind, part.change) == ("thin handle", 2, "thin part", -2)
    assert handle.width == pytest.approx(2 * MINOR, rel=0.1)


def test_doubts_of_a_cloud_are_where_it_is_narrower_than_its_resolution() -> None:
    shape = tk.from_points(torus_samples(500, 1.0, 0.12).points)
    report = shape.report(features=True)
    assert report.resolution > 0.24
    assert {(doubt.kind, doubt.change) for doubt in report.doubts} >= {("thin handle", 2), ("thin part", -2)}
    assert all(0 <= doubt.votes <= 1 and doubt.width <= report.resolution for doubt in report.doubts)
    assert f"{len(report.doubts)} places are doubtful" in report.text()
    assert "Thin handle, 0." in report.text()
    assert "votes for it" in report._repr_html_()
    assert json.loads(report.to_json())["doubts"][0]["kind"] == report.doubts[0].kind
    wide = tk.from_points(torus_samples(1500, 1.0, 0.4).points).report(features=True)
    assert wide.doubts == ()


def test_an_unsure_report_names_its_doubts_unasked() -> None:
    """Two spheres nearer than the spacing: whether they touch is doubtful."""
    sphere = sphere_samples(700).points
    shape = tk.from_points(torch.cat([sphere, sphere + torch.tensor([2.1, 0.0, 0.0])]))
    report = shape.report()
    assert report.verdict == "unsure"
    [doubt] = report.doubts
    assert (doubt.kind, doubt.change, doubt.votes) == ("narrow gap", -2, pytest.approx(0.1, abs=0.05))
    assert doubt.place == pytest.approx((1.05, 0, 0), abs=0.15)
    assert shape.report().doubts is report.doubts


def test_points_off_the_surface_are_a_doubt() -> None:
    """A small sheet inside a sphere."""
    sheet = torch.cartesian_prod(*[torch.linspace(0, 0.4, 5)] * 2, torch.zeros(1))
    report = tk.from_points(torch.cat([sphere_samples(1200).points, sheet])).report(features=True)
    [missed] = report.doubts
    assert (missed.kind, missed.change, missed.width) == ("missed samples", None, pytest.approx(0.4))
    assert missed.place == pytest.approx((0.2, 0.2, 0))
    assert "does not pass through them" in report.text()
    assert "missed samples" in report._repr_html_()


def test_what_is_counted_has_no_doubts() -> None:
    assert tk.report(tk.from_mesh(torus_mesh()), features=0.3).doubts is None


def test_narrow_places_need_a_surface_a_width_and_a_grid() -> None:
    vertices, faces = torus_mesh()
    with pytest.raises(tk.InputError, match="not closed"):
        tk.from_mesh(vertices, faces[100:]).narrow_places(below=0.1)
    with pytest.raises(tk.InputError, match="positive width"):
        tk.from_mesh(torus_mesh()).narrow_places(below=-1)
    with pytest.raises(tk.InputError, match="ask for those below"):
        tk.from_mesh(torus_mesh()).narrow_places(below=1e-6)


def test_features_of_a_scan_are_placed_as_its_file_says(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed; make test installs it")
    ring = np.zeros((16, 16, 8), np.uint8)
    ring[2:14, 2:14, 2:6] = 1
    ring[6:10, 6:10] = 0
    nibabel.save(nibabel.Nifti1Image(ring, np.diag([-1.0, -1, 1, 1])), tmp_path / "ring.nii")
    text = tk.load(tmp_path / "ring.nii").report(features=True).text()
    assert re.search(
        r"Tunnel: \S+ wide, its handle \S+ thick, at \(-[78]\.\S+ \S+ \S+\) mm RAS, voxel index \([78], [78], \d\)",
        text,
    )
