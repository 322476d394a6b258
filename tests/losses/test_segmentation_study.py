"""The study of `benchmarks/segmentation.py`: its masks are as they say, and a step of each loss trains."""

from __future__ import annotations

import importlib
from types import ModuleType

import numpy as np
import pytest
import torch
from skimage.measure import euler_number, label

from benchmarks.noisy_masks import FAMILIES, noisy_mask
from benchmarks.segmentation_losses import COMPETITORS, skeleton_recall

SIDES = {2: 48, 3: 24}


@pytest.fixture(scope="module")
def study() -> ModuleType:
    """Imported by the tests that need it: MONAI takes seconds in every process that collects."""
    pytest.importorskip("monai", reason="the network of the study is MONAI's")
    return importlib.import_module("benchmarks.segmentation")


@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("family", FAMILIES)
def test_masks_have_the_topology_they_say_and_images_are_the_same_for_the_same_seed(family: str, dims: int) -> None:
    one, again, other = (noisy_mask(family, dims, SIDES[dims], seed) for seed in (1, 1, 2))
    assert np.array_equal(one.image, again.image)
    assert not np.array_equal(one.mask, other.mask)
    parts = label(one.mask, connectivity=dims).max()
    outside = label(~np.pad(one.mask, 1), connectivity=1).max() - 1  # holes in the plane, cavities in space
    tunnels = parts + outside - euler_number(one.mask, connectivity=dims) if dims == 3 else outside
    assert one.betti == (parts, tunnels, outside if dims == 3 else 0)
    assert one.image[one.mask].mean() > one.image[~one.mask].mean() + 0.5


@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("name", COMPETITORS)
def test_a_step_of_each_loss_changes_the_network_as_no_other_does(study: ModuleType, name: str, dims: int) -> None:
    one = COMPETITORS[name]
    if dims not in one.dims:
        pytest.skip(f"{name} is not for {dims} dimensions")
    if not one.is_here:
        pytest.skip(f"{name} needs {one.module}, which cannot be imported")
    data = study.images_of("trees", dims, SIDES[dims], range(2), "cpu")
    weights = []
    for weight in (one.weight, 0.0):
        net = study.network(dims, 0)
        (seconds,) = study.train(net, data, one.make(), weight, steps=1, seed=0, decays=True)
        weights.append(torch.cat([parameter.detach().flatten() for parameter in net.parameters()]))
        assert seconds > 0
        assert weights[-1].isfinite().all()
    assert torch.equal(*weights) == (one.weight == 0)


def test_a_perfect_segmentation_has_no_errors_and_an_empty_one_misses_every_feature(study: ModuleType) -> None:
    data = study.images_of("sheets", 2, SIDES[2], range(3), "cpu")

    class Told(torch.nn.Module):
        def __init__(self, masks: torch.Tensor) -> None:
            super().__init__()
            self.left = list(masks.split(4))

        def forward(self, images: torch.Tensor) -> torch.Tensor:
            mask = self.left.pop(0)
            return torch.cat((1 - mask, mask), 1).float()

    right, empty = study.measured(Told(data.masks), data), study.measured(Told(0 * data.masks), data)
    assert (right["dice"], right["missing"], right["spurious"], right["betti_error"]) == (1, 0, 0, 0)
    n_features = [sum(noisy_mask("sheets", 2, SIDES[2], seed).betti) for seed in range(3)]
    assert empty["missing"] == pytest.approx(np.mean(n_features))
    assert "| a | 1.000 ± 0.000 |" in study.table([{"a": right}])


def test_skeleton_recall_is_the_share_of_the_skeleton_that_is_missed() -> None:
    mask = torch.zeros(1, 1, 16, 16, dtype=torch.long)
    mask[..., 7, 2:14] = 1
    logits = 20.0 * torch.cat((1 - mask, mask), 1).float()
    assert float(skeleton_recall(logits, mask)) == pytest.approx(0, abs=1e-5)
    logits[:, 1, :, 8:] = -20
    assert float(skeleton_recall(logits, mask)) == pytest.approx(0.5, abs=1e-5)
