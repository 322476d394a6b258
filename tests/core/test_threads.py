"""Work on one thread leaves the number of threads as it was, also after an error."""

from __future__ import annotations

import pytest
import torch

from topokit.core.chunks import in_chunks
from topokit.core.threads import one_thread


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


def test_blocks_of_rows_run_on_one_thread() -> None:
    before, seen = torch.get_num_threads(), []
    try:
        torch.set_num_threads(2)
        in_chunks(lambda rows: (seen.append(torch.get_num_threads()) or rows,), 10, torch.device("cpu"), chunk=4)
        assert seen == [1, 1, 1]
    finally:
        torch.set_num_threads(before)
