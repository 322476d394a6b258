"""The calibrated probability that the integer of a cloud is right."""

from __future__ import annotations

import json
import math

import pytest
import torch

import topokit as tk
from topokit.report.confidence import EVIDENCE, INTERCEPT
from topokit.report.verdict import THRESHOLDS
from topokit.testing import genus_mesh, sphere_samples, torus_mesh, torus_samples

NOISY_BALL = torch.randn(1500, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.mark.parametrize("name", EVIDENCE)
def test_no_evidence_against_an_answer_raises_its_confidence(name: str) -> None:
    one = EVIDENCE[name]
    assert one.coefficient >= 0
    assert one.of(0.0) == 0.0
    values = [one.of(value) for value in (0.0, 0.001, 0.01, 0.1, 0.5, 1.0)]
    assert values == sorted(values)


def test_an_answer_without_doubt_is_likely() -> None:
    assert 1 / (1 + math.exp(-INTERCEPT)) > THRESHOLDS["confidence"].value


@pytest.mark.parametrize("known", [sphere_samples(1500), torus_samples(1500)], ids=["sphere", "torus"])
def test_clean_smooth_clouds_are_likely_and_say_how_likely(known: object) -> None:
    report = tk.from_points(known.points).report()  # type: ignore[attr-defined]
    assert report.verdict == "likely"
    assert report.confidence is not None
    assert THRESHOLDS["confidence"].value <= report.confidence < 1
    assert f"right {int(100 * report.confidence)}% of the time" in report.reasons[0]  # 100% would be a proof
    assert json.loads(report.to_json())["confidence"] == report.confidence


def test_a_blob_of_noise_is_unsure_and_its_confidence_low() -> None:
    report = tk.from_points(NOISY_BALL).report()
    assert report.verdict == "unsure"
    assert report.confidence is None or report.confidence < 0.6  # about features wider than its own radius


def test_counting_is_certain_and_what_is_not_calibrated_has_no_confidence() -> None:
    assert tk.from_mesh(*genus_mesh(2)).report().confidence == 1.0
    vertices, faces = torus_mesh()
    assert tk.from_mesh(vertices, faces[1:]).report().confidence == 1.0  # open, and counted all the same
    assert tk.from_sdf(lambda p: p.norm(dim=1) - 0.5, resolution=128).report(certify=False).confidence is None
