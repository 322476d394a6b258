"""Stages of long computations: who hears of them, and when."""

from __future__ import annotations

from contextlib import nullcontext

import pytest

import topokit as tk
from topokit.core.cloud.settings import CloudSettings, SamplingSettings
from topokit.core.cloud.witness import global_witness
from topokit.core.progress import Listener, advance, begin, ignore, listening, stages
from topokit.report.progress import progress_bar, time_left
from topokit.testing import torus_samples

Heard = list[tuple[str, float]]


def test_a_listener_is_told_the_share_before_each_stage() -> None:
    heard: Heard = []
    with listening(lambda stage, share: heard.append((stage, share))), stages({"one": 1.0, "two": 2.0, "three": 1.0}):
        begin("one")
        begin("three")  # the second is skipped
        with stages({"part": 1.0}):
            begin("part")
    begin("one")
    assert heard == [("one", 0.0), ("three", 0.75)]


def test_nobody_listens_by_default() -> None:
    with stages({"one": 1.0}):
        begin("one")
        advance(1.0)


def test_the_share_of_a_stage_counts_and_never_falls() -> None:
    heard: Heard = []
    with listening(lambda stage, share: heard.append((stage, share))), stages({"one": 1.0, "two": 3.0}):
        begin("one")
        advance(0.5)
        advance(0.25)  # a part of it is done again
        begin("two")
        advance(1.0)
        begin("unannounced")
        advance(0.5)
    assert heard == [
        *[("one", 0.0), ("one", 0.125), ("one", 0.125)],
        *[("two", 0.25), ("two", 1.0), ("unannounced", 1.0), ("unannounced", 1.0)],
    ]


@pytest.mark.parametrize("whole", [30_000, 2_000])
def test_a_cloud_tells_its_stages_in_order(whole: int) -> None:
    heard: Heard = []
    settings = CloudSettings(sampling=SamplingSettings(whole=whole, samples=1_500))
    with listening(lambda stage, share: heard.append((stage, share))):
        found = global_witness(torus_samples(2500).points, settings=settings)
    assert (found.euler, found.preparation) == (0, "whole" if whole > 2500 else "sampled")
    assert heard[0] == ("neighborhoods", 0.0)
    assert list(dict(heard)) == ["neighborhoods", "signs", "orientation", "counting"]
    shares = [share for _, share in heard]
    assert shares == sorted(shares)
    assert 0.2 < shares[-1] < 1


@pytest.mark.parametrize(("is_terminal", "patience"), [(True, 0.0), (True, 1e3), (False, 0.0)])
def test_a_bar_is_shown_on_terminals_after_a_while(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], is_terminal: bool, patience: float
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr("topokit.report.progress._PATIENCE", patience)
    monkeypatch.setattr("sys.stderr.isatty", lambda: is_terminal)
    tk.from_points(torus_samples(3000).points).report()
    err = capsys.readouterr().err
    assert ("3000 points: counting" in err and "s left" in err) == (is_terminal and patience == 0)


@pytest.mark.parametrize("others", [ignore, None])
def test_no_second_bar_is_drawn(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], others: Listener | None
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    hearing = nullcontext() if others is None else listening(others)
    outer, inner = (progress_bar([name], patience=0) for name in ("outer", "inner"))
    with hearing, outer, inner, stages({"one": 1.0}):
        begin("one")
    err = capsys.readouterr().err
    assert "inner" not in err
    assert ("outer: one" in err) == (others is None)


def test_time_left() -> None:
    assert [time_left(5, 0), time_left(5, 0.25), time_left(60, 0.1)] == ["", "about 15 s left", "about 9 min left"]
    assert time_left(5, 1) == "", "what is counted after the last grid takes its time"
