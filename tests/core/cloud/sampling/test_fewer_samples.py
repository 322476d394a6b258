"""Shapes with fewer samples: attributes are kept, areas summed, meshes sampled by feature size."""

from __future__ import annotations

from typing import get_args

import pytest
import torch

import topokit as tk
from topokit.core.cloud.sampling.downsampling import Criterion
from topokit.core.samples import SurfaceSamples
from topokit.testing import genus_mesh, torus_samples


@pytest.mark.parametrize("by", get_args(Criterion))
def test_attributes_are_kept_and_areas_summed(by: Criterion) -> None:
    known = torus_samples(6000)
    areas = torch.full((6000,), known.area / 6000, dtype=torch.float64)
    points = known.points.clone().requires_grad_()
    shape = tk.Shape(SurfaceSamples(points, known.normals, areas=areas), name="ring")
    fewer = shape.downsample(1000, by)
    samples = fewer.samples
    assert 850 <= samples.n_points <= 1000
    assert samples.oriented
    assert samples.normals is not None
    assert samples.areas is not None
    assert float(samples.areas.sum()) == pytest.approx(known.area)
    row = int(torch.cdist(samples.points[:1].detach(), known.points).argmin())
    torch.testing.assert_close(samples.normals[0], known.normals[row])
    samples.points.sum().backward()
    assert points.grad is not None
    assert int((points.grad != 0).any(1).sum()) == samples.n_points
    assert fewer.name == "ring"


def test_a_counted_answer_is_kept() -> None:
    mesh = tk.from_mesh(*genus_mesh(2))
    fewer = mesh.downsample(2000)
    assert (fewer.report().euler, fewer.report().verdict) == (-2, "certain")
    assert fewer.mesh is mesh.mesh


@pytest.mark.parametrize("sampling", ["feature-size", "curvature", "even"])
def test_meshes_are_sampled_by_a_criterion(sampling: str) -> None:
    vertices, faces = genus_mesh(2)
    corners = torch.as_tensor(vertices, dtype=torch.float64).requires_grad_()
    shape = tk.from_mesh(corners, faces, n_samples=3000, sampling=sampling)
    assert 2500 <= shape.samples.n_points <= 3000
    assert shape.samples.areas is not None
    area = shape.samples.areas.sum()
    triangles = corners.detach()[torch.as_tensor(faces).long()]
    cross = torch.linalg.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0], dim=-1)
    assert float(area) == pytest.approx(float(cross.norm(dim=-1).sum() / 2))
    area.backward()
    assert corners.grad is not None
    assert bool(torch.isfinite(corners.grad).all())


@pytest.mark.parametrize("by", get_args(Criterion))
def test_points_at_few_places_are_chosen_evenly(by: Criterion) -> None:
    points = torus_samples(30).points.repeat(10, 1)
    fewer = tk.Shape(SurfaceSamples(points)).downsample(28, by).samples
    assert 21 <= fewer.n_points <= 28
    assert len(torch.unique(fewer.points, dim=0)) == fewer.n_points


def test_what_cannot_be_downsampled_is_refused() -> None:
    points = torus_samples(500).points
    with pytest.raises(tk.InputError, match="expected one of"):
        tk.from_points(points).downsample(100, by="random")
    with pytest.raises(tk.InputError, match="batched"):
        tk.from_points(points.expand(2, 500, 3)).downsample(100)
    with pytest.raises(tk.InputError, match="at least 4"):
        tk.from_points(points).downsample(2)
    with pytest.raises(tk.InputError, match="expected one of"):
        tk.from_mesh(*genus_mesh(1), sampling="poisson")
