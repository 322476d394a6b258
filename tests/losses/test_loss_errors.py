"""What the Euler loss refuses, and in which words."""

from __future__ import annotations

import math

import pytest
import torch

import topokit as tk
from topokit.errors import InputError
from topokit.testing import torus_samples

IMPOSSIBLE = (
    "no closed surface of a solid with components={} and cavities={} has χ = {}: χ = 2 (components + cavities − "
    "genus). Change components, or pass components=None to ask for χ alone."
)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give either target or genus: got target=None and genus=None."),
        ({"target": 2.0, "genus": 0}, "give either target or genus: got target=2.0 and genus=0."),
        ({"target": 3.0}, IMPOSSIBLE.format(1, 0, 3)),
        ({"target": 4.0}, IMPOSSIBLE.format(1, 0, 4)),
        ({"genus": -1}, IMPOSSIBLE.format(1, 0, 4)),
        ({"genus": 0.5}, IMPOSSIBLE.format(1, 0, 1)),
        ({"target": 0.0, "components": 0}, IMPOSSIBLE.format(0, 0, 0)),
        ({"target": 1.0, "components": 1.5}, IMPOSSIBLE.format(1.5, 0, 1)),
        ({"target": 2.0, "cavities": -1}, IMPOSSIBLE.format(1, -1, 2)),
        ({"genus": (1, 0.5)}, IMPOSSIBLE.format(1, 0, 1)),
        (
            {"genus": (1, 0), "cavities": 1},
            "one genus per component goes with cavities=0, and says itself that there are 2 components; got "
            "components=1 and cavities=1.",
        ),
        (
            {"target": (0, 2), "components": 3},
            "one target per component goes with cavities=0, and says itself that there are 2 components; got "
            "components=3 and cavities=0.",
        ),
        ({"target": ()}, "target must be a finite number, or a list of one for each component, not ()."),
        ({"target": "2"}, "target must be a finite number, or a list of one for each component, not '2'."),
        ({"genus": math.nan}, "genus must be a finite number, or a list of one for each component, not nan."),
        ({"genus": 0, "components": None}, "genus needs components: without them it does not say what χ is."),
        (
            {"target": 2.0, "components": None, "cavities": 1},
            "cavities need components: χ alone does not tell them from components.",
        ),
        (
            {"target": 2.0, "components": None, "change": "add"},
            "change='add' needs components: χ alone knows no such distinction.",
        ),
        ({"genus": 0, "change": "both"}, "change must be one of ('any', 'add', 'remove'), not 'both'."),
        ({"genus": 0, "reduction": "max"}, "reduction must be one of ('mean', 'sum', 'none'), not 'max'."),
        ({"genus": 0, "connectivity": 18}, "connectivity must be 6 or 26, not 18."),
        ({"genus": 0, "level": math.nan}, "level must be a finite number, not nan."),
        ({"genus": 0, "refresh": 0}, "refresh and look_every must be at least 1, got 0 and 1."),
        ({"genus": 0, "look_every": 0}, "refresh and look_every must be at least 1, got 20 and 0."),
        ({"genus": 0, "resolution": 8}, "resolution must be at least 16 grid points, not 8."),
        ({"genus": 0, "euler_weight": -1}, "euler_weight must be finite and not negative, not -1."),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(InputError) as caught:
        tk.EulerLoss(**options)
    assert str(caught.value) == message


@pytest.mark.parametrize("tau", [0, -1.0, math.nan, math.inf, 1e-320, torch.tensor([0.1, 0.2])])
def test_wrong_tau_is_named(tau):
    for options in ({}, {"components": None}):
        with pytest.raises(InputError) as caught:
            tk.euler_loss(torch.ones(3, 3, 3), 2.0, tau, **options)
        assert str(caught.value) == f"tau must be a positive number, not {tau!r}."


def test_wrong_sources_are_named():
    said = "the loss got a tensor of shape {} and type {}; expected a floating-point field (..., X, Y, Z), positive "
    for shape in ((4, 4), (0, 4, 4), (0, 2, 2, 2), (4, 4, 4)):
        field = torch.ones(shape, dtype=torch.int32 if shape == (4, 4, 4) else torch.float32)
        for options in ({}, {"components": None}):
            with pytest.raises(InputError) as caught:
                tk.euler_loss(field, 2.0, 0.1, **options)
            assert str(caught.value) == said.format(tuple(field.shape), field.dtype) + "inside and not empty."
    with pytest.raises(InputError) as caught:
        tk.euler_loss([[[1.0]]], 2.0, 0.1)
    assert str(caught.value) == "the loss got list; expected a field (..., X, Y, Z), positive inside, or a Shape."
    with pytest.raises(InputError, match=r"neither a field nor one cloud with oriented normals: use shape\.oriented\("):
        tk.euler_loss(tk.from_points(torus_samples(300).points), 2.0, 0.1)
    with pytest.raises(InputError, match=r"level=0\.1 is that of a plain field; .* has its own: give it to from_sdf"):
        tk.euler_loss(tk.from_points(torus_samples(300).points), 2.0, 0.1, level=0.1)
