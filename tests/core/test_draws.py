"""Stratified draws and seeds that are fixed early."""

from __future__ import annotations

import pytest
import torch

from topokit.core.draws import check_sample_count, deferred_seed, stratified_draw
from topokit.errors import InputError


def test_every_share_of_the_weight_is_drawn_once(generator: torch.Generator) -> None:
    weights = torch.rand(500, dtype=torch.float64, generator=generator)
    weights[100:200] = 0
    drawn = stratified_draw(weights, 20_000, generator)
    assert (drawn.diff() >= 0).all()
    counts = torch.bincount(drawn, minlength=500).double()
    assert counts[100:200].sum() == 0
    torch.testing.assert_close(counts / 20_000, weights / weights.sum(), rtol=0, atol=2 / 20_000)


def test_a_deferred_seed_takes_one_number_from_the_generator() -> None:
    assert deferred_seed(None) == 0
    one, two = torch.Generator().manual_seed(3), torch.Generator().manual_seed(3)
    seeds = [deferred_seed(one), deferred_seed(one)]
    assert seeds == [deferred_seed(two), deferred_seed(two)]
    assert seeds[0] != seeds[1]
    torch.manual_seed(5)
    before = torch.get_rng_state()
    deferred_seed(one)
    assert torch.equal(torch.get_rng_state(), before)


def test_more_samples_than_neighbors() -> None:
    check_sample_count(21, 20)
    with pytest.raises(InputError, match="n_samples is 20; it must be larger than n_neighbors, which is 20"):
        check_sample_count(20, 20)
