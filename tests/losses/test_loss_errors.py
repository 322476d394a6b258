"""What the losses refuse, and in which words."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

import topokit as tk
from topokit.errors import InputError
from topokit.testing import torus_samples

FUNCTIONS: list[Callable[..., Tensor]] = [tk.euler_loss, tk.topology_loss]


def refusal(call: Callable[[], object]) -> str:
    with pytest.raises(InputError) as caught:
        call()
    return str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"genus": -1}, "genus must be an integer of at least 0, not -1."),
        ({"genus": 0.5}, "genus must be an integer of at least 0, not 0.5."),
        ({"genus": "2"}, "genus must be an integer of at least 0, not '2'."),
        ({"genus": (1, 0.5)}, "genus must be an integer of at least 0, not 0.5."),
        ({"genus": 0, "components": 0}, "components must be an integer of at least 1, not 0."),
        ({"genus": 0, "components": 1.5}, "components must be an integer of at least 1, not 1.5."),
        ({"genus": 0, "components": None}, "components must be an integer of at least 1, not None."),
        ({"genus": 0, "components": True}, "components must be an integer of at least 1, not True."),
        ({"genus": 0, "cavities": -1}, "cavities must be an integer of at least 0, not -1."),
        (
            {"genus": (1, 0), "cavities": 1},
            "a list of genera needs one genus for each component, cavities=0 and at_most=False; got 2 with "
            "components=1, cavities=1 and at_most=False.",
        ),
        (
            {"genus": (1, 0), "components": 3},
            "a list of genera needs one genus for each component, cavities=0 and at_most=False; got 2 with "
            "components=3, cavities=0 and at_most=False.",
        ),
        (
            {"genus": ()},
            "a list of genera needs one genus for each component, cavities=0 and at_most=False; got 0 with "
            "components=1, cavities=0 and at_most=False.",
        ),
        ({"genus": 0, "change": "both"}, "change must be one of ('any', 'add', 'remove'), not 'both'."),
        ({"genus": 0, "reduction": "max"}, "reduction must be one of ('mean', 'sum', 'none'), not 'max'."),
        ({"genus": 0, "level": math.nan}, "level must be a finite number, not nan."),
        ({"genus": 0, "level": "0"}, "level must be a finite number, not '0'."),
        ({"genus": 0, "resolution": 8}, "resolution must be an integer of at least 16, not 8."),
        ({"genus": 0, "resolution": 64.0}, "resolution must be an integer of at least 16, not 64.0."),
        ({"genus": 0, "search_every": 0}, "search_every must be an integer of at least 1, not 0."),
        ({"genus": 0, "betti": (1, 0, 0)}, "pass genus, with components and cavities, or betti; not both."),
    ],
)
def test_wrong_options_of_the_topology_loss_are_named(options: dict[str, Any], message: str) -> None:
    assert refusal(lambda: tk.TopologyLoss(**options)) == message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"target": None}, "target must be a finite number, not None."),
        ({"target": math.inf}, "target must be a finite number, not inf."),
        ({"target": (0, 2)}, "target must be a finite number, not (0, 2)."),
        ({"target": 2.0, "connectivity": 18}, "connectivity must be one of (6, 26), not 18."),
        ({"target": 2.0, "reduction": None}, "reduction must be one of ('mean', 'sum', 'none'), not None."),
    ],
)
def test_wrong_options_of_the_euler_loss_are_named(options: dict[str, Any], message: str) -> None:
    assert refusal(lambda: tk.EulerLoss(**options)) == message


def test_integers_of_numpy_are_integers() -> None:
    loss = tk.TopologyLoss(np.int64(1), components=np.int32(2), search_every=np.int64(3))
    assert loss.goal is not None
    assert loss.goal.betti == (2, 1, 0)
    assert all(type(number) is int for number in loss.goal.betti)


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("tau", [0, -1.0, math.nan, math.inf, 1e-320, True, "0.1", torch.tensor([0.1, 0.2])])
def test_wrong_tau_is_named(function: Callable[..., Tensor], tau: Any) -> None:
    assert refusal(lambda: function(torch.ones(3, 3, 3), 2, tau)) == f"tau must be a positive number, not {tau!r}."


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize(
    ("shape", "dtype"),
    [((4, 4), torch.float32), ((0, 4, 4), torch.float32), ((0, 2, 2, 2), torch.float32), ((4, 4, 4), torch.int32)],
)
def test_wrong_tensors_are_named(function: Callable[..., Tensor], shape: tuple[int, ...], dtype: torch.dtype) -> None:
    assert refusal(lambda: function(torch.ones(shape, dtype=dtype), 2, 0.1)) == (
        "expected a floating-point field (..., X, Y, Z), positive inside and not empty; got a tensor of shape "
        f"{shape} and type {dtype}."
    )


@pytest.mark.parametrize("function", FUNCTIONS)
def test_wrong_sources_are_named(function: Callable[..., Tensor]) -> None:
    expected = "expected a field (..., X, Y, Z), positive inside, or a Shape; got "
    assert refusal(lambda: function([[[1.0]]], 2, 0.1)) == expected + "list."
    advice = "Linear. Wrap a network as a shape: tk.from_sdf(net)."
    assert refusal(lambda: function(nn.Linear(3, 1), 2, 0.1)) == expected + advice
    cloud = tk.from_points(torus_samples(300).points)
    assert refusal(lambda: function(cloud, 2, 0.1)) == (
        f"{cloud.name} is neither a field nor samples with oriented normals: use shape.oriented(), or pass "
        "normals to from_points."
    )
    assert refusal(lambda: function(cloud, 2, 0.1, level=0.1)) == (
        f"level=0.1 is for plain fields, and {cloud.name} is a shape: pass the level to from_sdf, from_occupancy or "
        "from_voxels. Samples have none."
    )


def test_only_plain_fields_are_said_to_be_log_odds() -> None:
    cloud = tk.from_points(torus_samples(300).points)
    assert refusal(lambda: tk.TopologyLoss(0, logits=True)(cloud)) == (
        f"logits=True is for plain fields, and {cloud.name} is a shape: a function says so where it becomes one, "
        "from_occupancy(net, logits=True)."
    )
