"""Calls by guess: an option with a wrong name, or a value without one, is an error that says the right call."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import topokit as tk
from topokit.inputs.calls import no_option
from topokit.testing import torus_mesh, torus_samples

VOLUME = np.linspace(0, 1, 27).reshape(3, 3, 3)
POINTS = torus_samples(300).points
OPENERS = (tk.from_mesh, tk.from_points, tk.from_voxels, tk.from_labels, tk.from_sdf, tk.from_occupancy, tk.from_splats)


def said(function: Any, *args: Any, **options: Any) -> str:
    with pytest.raises(TypeError) as found:
        function(*args, **options)
    return str(found.value)


@pytest.mark.parametrize("opener", OPENERS, ids=lambda one: one.__name__)
def test_a_typing_error_in_any_option_names_the_right_one(opener: Any) -> None:
    for name in inspect.signature(opener).parameters:
        if len(name) > 1:
            assert f" Did you mean {name}?" in said(opener, VOLUME, **{f"{name}x": 1}), name
    assert "Did you mean" not in said(opener, VOLUME, qqqq=1)


def test_words_that_are_usual_elsewhere_are_known() -> None:
    assert "has no option 'threshold'. Did you mean level?" in said(tk.from_voxels, VOLUME, threshold=0.5)
    assert "Did you mean n_neighbors?" in said(tk.from_points, POINTS, k=10)
    assert "Did you mean faces?" in said(tk.from_mesh, VOLUME[0], triangles=VOLUME[0])
    assert "Did you mean source?" in said(tk.from_mesh, vertices=VOLUME[0])
    assert "Did you mean generator=torch.Generator().manual_seed(...)?" in said(tk.from_sdf, abs, seed=1)
    assert "manual_seed" not in said(tk.from_points, POINTS, seed=1)  # nothing is drawn there
    assert "TopologyLoss has no option 'pieces', 'tunnels'. Did you mean betti=(pieces, tunnels, cavities)? It" in said(
        tk.TopologyLoss, pieces=1, tunnels=0
    )
    assert no_option("it", ["b", "a"], ["d", "c"]) == "it has no option 'a', 'b'. It has: c, d."


def test_a_value_without_a_name_is_told_its_name() -> None:
    assert said(tk.from_voxels, VOLUME, 0.5).startswith(
        "from_voxels(volume) takes no value after volume without its name: write level=..., for example. It has: axis, "
    )
    assert "after normals without its name: write n_neighbors=..." in said(tk.from_points, POINTS, POINTS, 10)
    assert said(tk.TopologyLoss, 0, 1).startswith("TopologyLoss(genus) takes no value after genus without its name: ")
    assert tk.from_voxels(VOLUME, level=0.5).report().pieces == 1


def test_load_says_it_too() -> None:
    with pytest.raises(tk.InputError, match=r"'mesh' has no option 'n_sample'\. Did you mean n_samples\? It has: "):
        tk.load(torus_mesh(), n_sample=100)


def test_vertices_and_faces_are_a_mesh() -> None:
    vertices, faces = torus_mesh()
    assert tk.load((vertices, faces)).genus() == tk.genus((vertices, faces)) == tk.report((vertices, faces)).genus == 1
    with pytest.raises(tk.InputError, match=r"whole numbers, got float64\. For points and normals use topokit\.from_p"):
        tk.load((POINTS, POINTS))
    with pytest.raises(tk.InputError, match="vertices and faces"):
        tk.load((POINTS,))
