"""A report that is unsure ends with what would help most."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from witnesses import a_wire, a_witness

import topokit as tk
from topokit.core.cloud.given_normals import Signs
from topokit.report.advice import cloud_advice
from topokit.report.report import known_genus
from topokit.report.verdict import Check
from topokit.testing import torus_samples

NO_NORMALS = Signs("none", None, 0.5)


@pytest.mark.parametrize(
    ("seen", "failed", "named"),
    [
        ({}, "cuts", {"3600"}),
        ({"signs": NO_NORMALS}, "cuts", {"3600", "normals"}),
        ({"preparation": "averaged", "signs": NO_NORMALS}, "fields", {"noise", "normals"}),
        ({"quality": {"roughness": 5.0}}, "fields", {"noise"}),
        ({"wire": a_wire()}, "wire_share", {"3600"}),
        ({"signs": Signs("contradictory", 0.6, 0.9)}, "contradictory", {"normals"}),
        ({}, "rim", {"evenly"}),
        ({}, "rounding", {"offset", "precision"}),
    ],
)
def test_the_advice_for_a_cloud_follows_from_its_evidence(seen: dict[str, Any], failed: str, named: set[str]) -> None:
    advice = cloud_advice(a_witness(**seen), 900, [Check("coverage", 1.0, True), Check(failed, 0.0, False)])
    assert advice is not None
    words = {"3600", "normals", "noise", "evenly", "offset", "precision"}
    assert {word for word in words if word in advice} == named


def test_few_points_need_more_and_what_bounds_nothing_gets_no_advice() -> None:
    assert "At least 150 " in str(cloud_advice(None, 100))
    assert cloud_advice(None, 10_000) is None


def test_an_unsure_report_ends_with_its_advice_and_so_does_the_error_of_its_genus() -> None:
    points = torus_samples(60).points
    report = tk.from_points(points).report()
    assert (report.verdict, report.advice is None) == ("unsure", False)
    assert report.text().splitlines()[-1] == f"  Advice: {report.advice}"
    assert report.to_dict()["advice"] == report.advice
    assert f"{report.advice}" in report._repr_html_()


def test_splats_of_a_scene_are_advised_to_keep_the_object_alone() -> None:
    count = 400
    points = torch.randn(count, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    upright = torch.tensor([1.0, 0, 0, 0]).double().expand(count, 4)
    scene = tk.GaussianSplats(points, torch.full_like(points, 0.1), upright, torch.ones(count).double())
    report = tk.from_splats(scene).report()
    assert report.verdict == "unsure"
    with pytest.raises(tk.GenusError, match="--object"):
        known_genus(replace(report, genus=None), tuple)
    assert "--object" in report.text().splitlines()[-1]
    assert tk.from_splats(scene, component="largest").advice is None


def test_meshes_with_faults_name_the_call_that_finds_them_and_open_ones_that_which_closes_them() -> None:
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]])
    fan = tk.from_mesh(vertices, torch.tensor([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))
    assert "defects()" in fan.report().text().splitlines()[-1]
    with pytest.raises(tk.GenusError, match="topokit report --locate"):
        fan.genus()
    triangle = tk.from_mesh(vertices, torch.tensor([[0, 1, 2]])).report()
    assert (triangle.verdict, "fill_boundaries()" in str(triangle.advice)) == ("certain", True)
    assert triangle.text().splitlines()[-1] == f"  Advice: {triangle.advice}"
