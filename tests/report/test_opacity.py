"""The second witness of splats: when the solid that cannot be seen into counts, and what the report then says."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
import trimesh

import topokit as tk
from topokit.adapters.splats.absorption import gaussians_of
from topokit.core.opacity.scene import AbsorbingScene
from topokit.core.opacity.solid import OpacityReading
from topokit.core.samples import SurfaceSamples
from topokit.core.surface import TriangleSurface
from topokit.testing import genus_mesh, torus_samples

MESH = trimesh.Trimesh(*genus_mesh(3), process=False)
READING = OpacityReading(
    eulers=(-4,) * 16,
    euler=-4,
    share=1.0,
    hidden=0.0,
    surface=TriangleSurface(MESH.vertices, MESH.faces),
    resolution=0.1,
    seconds=0.0,
)


class Read:
    """A scene of which the reading is known; it notes for which widths it is asked."""

    def __init__(self, reading: OpacityReading | None) -> None:
        self.reading, self.asked = reading, []

    def read(self, finer_than: float | None) -> OpacityReading | None:
        self.asked.append(finer_than)
        return self.reading

    def smoothed_euler(self) -> None:
        """No graph."""


def shape_of(count: int, seed: int, reading: OpacityReading | None) -> tk.Shape:
    """Random samples of a surface of genus 3."""
    points, _ = trimesh.sample.sample_surface(MESH, count, seed=seed)
    samples = SurfaceSamples(torch.from_numpy(points.copy()), oriented=False)
    return tk.Shape(samples, opacity=Read(reading))


@pytest.fixture(scope="module")
def alone() -> tk.TopologyReport:
    """Too few samples, by themselves."""
    report = shape_of(160, 0, None).report()
    assert (report.closed, report.verdict) == (True, "unsure")
    assert report.euler != -4
    return report


def test_an_opaque_solid_that_is_seen_twice_as_fine_gives_the_integer(alone: tk.TopologyReport) -> None:
    shape = shape_of(160, 0, READING)
    report = shape.report()
    assert (report.euler, report.genus, report.solid_betti) == (-4, 3, (1, 3, 0))
    assert (report.verdict, report.confidence) == ("unsure", None)
    assert report.resolution == READING.resolution
    assert f"the samples alone give χ = {alone.euler}" in report.reasons[0]
    assert [one.integer for one in report.evidence if one.name == "opacity from outside"] == [-4]
    assert shape.surface().euler_number == -4
    assert shape.genus() == 3
    assert float(shape.euler()) == -4


@pytest.mark.parametrize(
    "changes",
    [
        {"eulers": (-4,) * 15 + (-2,), "share": 15 / 16},
        {"hidden": 0.1},
        {"resolution": 10.0},
        {"surface": None},
    ],
)
def test_a_doubtful_opaque_solid_does_not(alone: tk.TopologyReport, changes: dict[str, object]) -> None:
    report = shape_of(160, 0, replace(READING, **changes)).report()
    assert (report.euler, report.verdict) == (alone.euler, "unsure")
    assert any("What cannot be seen into from outside has χ = 0 in only" in sentence for sentence in report.reasons)


def test_light_that_passes_through_says_nothing(alone: tk.TopologyReport) -> None:
    assert shape_of(160, 0, None).report().reasons == alone.reasons


def test_agreement_makes_an_unsure_integer_likely() -> None:
    agreeing = replace(READING, eulers=(-4,) * 12 + (8,) * 4, share=0.75)
    report = shape_of(300, 0, agreeing).report()
    assert (report.euler, report.verdict, report.confidence) == (-4, "likely", None)
    assert "χ = -4, too, in 75% of its readings" in report.reasons[0]
    assert shape_of(300, 0, None).report().verdict == "unsure"
    assert shape_of(300, 0, replace(agreeing, hidden=0.1)).report().verdict == "unsure"


def test_agreement_does_not_replace_votes_of_the_samples(alone: tk.TopologyReport) -> None:
    agreeing = replace(READING, eulers=(alone.euler,) * 16, euler=alone.euler)
    report = shape_of(160, 0, agreeing).report()
    assert (report.euler, report.verdict) == (alone.euler, "unsure")
    assert report.reasons[0].startswith("Only 10 of 22 Delaunay cuts")


@pytest.fixture(scope="module")
def dense() -> SurfaceSamples:
    """Samples that suffice."""
    points = trimesh.sample.sample_surface_even(MESH, 1_500, seed=0)[0]
    return SurfaceSamples(torch.from_numpy(points.copy()), oriented=False)


def test_where_samples_suffice_opacity_is_asked_for_finer_features_only(dense: SurfaceSamples) -> None:
    scene = Read(None)
    report = tk.Shape(dense, opacity=scene).report()
    assert (report.euler, report.verdict) == (-4, "likely")
    assert scene.asked == [pytest.approx(0.65 * report.resolution)]


def test_a_likely_integer_is_unsure_if_finer_readings_contradict_it(dense: SurfaceSamples) -> None:
    other = replace(READING, eulers=(-2,) * 13 + (-4,) * 3, euler=-2, share=13 / 16)

    def verdict_with(reading: OpacityReading) -> tuple[int | None, str]:
        report = tk.Shape(dense, opacity=Read(reading)).report()
        return report.euler, report.verdict

    assert verdict_with(replace(READING, resolution=0.01)) == (-4, "likely")
    assert verdict_with(replace(other, resolution=0.01)) == (-4, "unsure")
    assert verdict_with(replace(other, resolution=1.0)) == (-4, "likely")
    assert verdict_with(replace(other, resolution=0.01, share=0.5)) == (-4, "likely")


def away_from_window(points: torch.Tensor) -> torch.Tensor:
    """Which points (N, 3) lie outside a round window at the side of a torus."""
    return (points - torch.tensor([1.4, 0, 0], dtype=torch.float64)).norm(dim=1) > 0.42


def torus_splats(has_window: bool) -> tk.GaussianSplats:
    """A torus that stops light, or has that window."""
    from splat_writers import torus_scene

    means, scales, quaternions, _ = (torch.from_numpy(part.copy()).double() for part in torus_scene(3_000))
    rows = away_from_window(means) if has_window else torch.ones(len(means), dtype=torch.bool)
    opacities = torch.full((len(means),), 0.9, dtype=torch.float64)
    return tk.GaussianSplats(means, 1.6 * scales, quaternions, opacities)[rows]


@pytest.mark.parametrize("has_window", [False, True])
def test_a_hole_of_the_samples_counts_only_where_light_enters(has_window: bool) -> None:
    known = torus_samples(800).points
    samples = SurfaceSamples(known[away_from_window(known)], oriented=False)
    alone = tk.Shape(samples).report()
    assert not alone.closed
    splats = torus_splats(has_window)
    shape = tk.Shape(samples, opacity=AbsorbingScene(lambda: gaussians_of(splats)))
    report = shape.report()
    assert report.closed is not has_window
    if has_window:
        assert report.reasons == alone.reasons
        return
    assert (report.euler, report.genus, report.verdict) == (0, 1, "unsure")
    assert report.reasons[0].endswith("the samples alone have holes, which other splats cover.")
    assert shape.surface().euler_number == 0


def test_its_readings_outlive_pickling() -> None:
    import pickle

    from splat_writers import torus_scene

    scene = torus_scene(500)
    splats = tk.GaussianSplats(*(torch.from_numpy(part.copy()) for part in scene))
    shape = tk.from_splats(splats)
    report = pickle.loads(pickle.dumps(shape)).report()
    assert (report.euler, report.verdict) == (shape.report().euler, shape.report().verdict)
