"""Work on one thread leaves the number of threads as it was, also after an error."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch

from topokit.core.cloud import witness
from topokit.core.cloud.votes import Vote
from topokit.core.processors import one_thread
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


@pytest.mark.parametrize("order", [("first", "second"), ("second", "first")])
def test_threads_that_overlap_leave_the_number_as_it_was(order: tuple[str, str]) -> None:
    """In those two, in the calling thread, and in threads that begin meanwhile or afterwards."""
    before, seen = torch.get_num_threads(), {}
    inside = {name: threading.Event() for name in order}
    may_leave = {name: threading.Event() for name in order}

    def work(name: str) -> None:
        with one_thread():
            inside[name].set()
            assert may_leave[name].wait(10)
            seen[name] = torch.get_num_threads()
        seen[f"{name} afterwards"] = torch.get_num_threads()

    def in_a_new_thread() -> int:
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(torch.get_num_threads).result(10)

    try:
        torch.set_num_threads(2)
        with ThreadPoolExecutor(2) as pool:
            futures = {}
            for name in ("first", "second"):
                futures[name] = pool.submit(work, name)
                assert inside[name].wait(10)
            seen["begun meanwhile"] = in_a_new_thread()
            for name in order:
                may_leave[name].set()
                futures[name].result(10)
        seen |= {"begun afterwards": in_a_new_thread(), "caller": torch.get_num_threads()}
    finally:
        torch.set_num_threads(before)
    others = ("first afterwards", "second afterwards", "begun meanwhile", "begun afterwards", "caller")
    assert seen == {"first": 1, "second": 1} | dict.fromkeys(others, 2)


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
