"""Work on one thread leaves the number of threads as it was, also after an error."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
import torch

from topokit.core.cloud import witness
from topokit.core.cloud.votes import Vote
from topokit.core.threads import one_thread
from topokit.testing import sphere_samples


def test_the_number_of_threads_is_restored() -> None:
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        with one_thread():
            assert torch.get_num_threads() == 1
            with one_thread():
                pass
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 2
        with pytest.raises(ZeroDivisionError), one_thread():
            _ = 1 / 0
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_the_witness_runs_on_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    before, seen = torch.get_num_threads(), []
    tally = witness.tally

    def spy(votes: Iterable[Vote]) -> tuple[int, float]:
        seen.append(torch.get_num_threads())
        return tally(votes)

    monkeypatch.setattr(witness, "tally", spy)
    try:
        torch.set_num_threads(2)
        witness.global_witness(sphere_samples(300).points)
        assert (seen, torch.get_num_threads()) == ([1], 2)
    finally:
        torch.set_num_threads(before)
