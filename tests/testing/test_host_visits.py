"""Host visits: everything that stops the queue of an accelerator is counted, and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from topokit.testing import count_host_visits

X = torch.arange(6.0)
VISITS: dict[str, Callable[[], object]] = {
    "item": lambda: X[2].item(),
    "bool": lambda: bool(X.any()),
    "float": lambda: float(X[1]),
    "comparison": lambda: 1 if X.sum() > 3 else 2,
    "numpy": lambda: X.numpy(),
    "asarray": lambda: np.asarray(X),
    "tolist": lambda: X.tolist(),
    "cpu": lambda: X.cpu(),
    "nonzero": lambda: X.nonzero(),
    "mask": lambda: X[X > 2],
    "masked_select": lambda: X.masked_select(X > 2),
    "unique": lambda: X.unique(),
    "write several by mask": lambda: X.clone().__setitem__(X > 3, torch.ones(2)),
    "repeat_interleave": lambda: X.repeat_interleave(torch.arange(6)),
    "constant": lambda: X.new_tensor([1.0, 2.0]),
    "eigh": lambda: torch.linalg.eigh(torch.eye(3)),
    "inv": lambda: torch.linalg.inv(torch.eye(3)),
    "equal": lambda: torch.equal(X, X),
}
QUIET: dict[str, Callable[[], object]] = {
    "arithmetic": lambda: (X.sort().values * 2 + X.cumsum(0)).sum(),
    "gather": lambda: X[torch.arange(3)],
    "where": lambda: torch.where(X > 2, X, 0.0),
    "write one by mask": lambda: X.clone().masked_fill_(X > 2, 1.0),
    "topk": lambda: X.topk(2),
    "shape": lambda: [len(X), X.shape, X.numel(), X.dtype],
    "inv_ex": lambda: torch.linalg.inv_ex(torch.eye(3)).inverse,
    "repeat_interleave": lambda: X.repeat_interleave(torch.ones(6, dtype=torch.int64), output_size=6),
}


@pytest.mark.parametrize("name", VISITS)
def test_each_visit_is_counted_once_with_its_place(name: str) -> None:
    with count_host_visits() as visits:
        VISITS[name]()
    assert len(visits) == 1, str(visits)
    assert __file__ in str(visits)


@pytest.mark.parametrize("name", QUIET)
def test_work_on_the_device_is_not_counted(name: str) -> None:
    with count_host_visits() as visits:
        QUIET[name]()
    assert str(visits) == "no visits"


def test_the_backward_pass_is_watched_too() -> None:
    class Looking(torch.autograd.Function):
        @staticmethod
        def forward(ctx: object, x: torch.Tensor) -> torch.Tensor:
            return x * 2

        @staticmethod
        def backward(ctx: object, slope: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
            return slope * float(slope.sum())

    leaf = torch.ones(3, requires_grad=True)
    with count_host_visits() as visits:
        Looking.apply(leaf).sum().backward()  # type: ignore[no-untyped-call]
    assert [visit.operation for visit in visits] == ["_local_scalar_dense"]
