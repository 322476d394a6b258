"""The Euler characteristic transform."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

import topokit as tk
from topokit.testing import genus_mesh, torus_mesh


def test_a_standing_torus_has_its_four_critical_heights() -> None:
    found = tk.from_mesh(torus_mesh(major=1, minor=0.4)).euler_transform([[2, 0, 0]], [-1.5, -1, 0, 1, 1.5])
    assert found.euler.tolist() == [[0, 1, 0, -1, 0]], "a disc, an annulus, a torus with a hole, the torus"


def test_all_of_the_surface_lies_below_the_largest_height() -> None:
    shape = tk.from_mesh(genus_mesh(3))
    found = shape.euler_transform(directions=7, heights=9)
    assert found.euler.shape == (7, 9)
    assert (found.euler[:, -1] == shape.euler()).all()
    assert torch.allclose(found.directions.norm(dim=1), torch.ones(7, dtype=found.directions.dtype))


def test_a_convex_surface_is_a_disc_below_every_height() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    found = tk.from_mesh(ball).euler_transform(20, np.linspace(-0.9, 0.9, 5))
    assert (found.euler == 1).all()


def test_volumes_take_their_surface() -> None:
    volume = np.zeros((12, 12, 12), bool)
    volume[3:9, 3:9, 3:9] = True
    assert tk.from_voxels(volume).euler_transform([[0, 0, 1]], [0, 6, 12]).euler.tolist() == [[0, 1, 2]]


def test_the_smooth_form_has_the_gradient_and_tends_to_the_count() -> None:
    vertices = torch.randn(5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    faces, along = torch.tensor([[0, 1, 2], [1, 2, 3], [2, 3, 4]]), torch.eye(3, dtype=torch.float64)[:2]
    heights = torch.linspace(-1, 1, 4, dtype=torch.float64)

    def smooth(points: torch.Tensor) -> torch.Tensor:
        return tk.from_mesh(points, faces).euler_transform(along, heights, sharpness=5).euler

    assert torch.autograd.gradcheck(smooth, (vertices,))
    shape = tk.from_mesh(torus_mesh())
    assert torch.allclose(
        shape.euler_transform(along, heights + 0.013, sharpness=1e7).euler,
        shape.euler_transform(along, heights + 0.013).euler.double(),
        atol=1e-3,
    )


@pytest.mark.parametrize(
    ("arguments", "name"),
    [(([[0, 0, 0]],), "directions"), ((3, [[1.0]]), "heights"), (([1, 0, 0],), "directions"), ((0,), "directions")],
)
def test_other_arguments_are_refused(arguments: tuple, name: str) -> None:
    with pytest.raises(tk.InputError, match=name):
        tk.from_mesh(torus_mesh()).euler_transform(*arguments)


def test_a_sharpness_is_positive() -> None:
    with pytest.raises(tk.InputError, match="sharpness"):
        tk.from_mesh(torus_mesh()).euler_transform(sharpness=0)
