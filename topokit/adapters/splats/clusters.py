"""Coherent clusters of discs, and the choice of one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.adapters.splats.disc_sizes import disc_weights
from topokit.adapters.splats.normals import rotation_matrices
from topokit.core.labels import connected_labels
from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.adapters.splats.gaussians import GaussianSplats

Component = Literal["largest", "all", "middle"] | int
_REACH = 1.5  # standard deviations, radius of a disc when clusters are formed
_LINK = 2.0  # cells of the cluster grid per median size
_LARGE = 0.2  # share of the largest cluster's area from which a cluster can be the object in the middle


def choose_clusters(
    splats: GaussianSplats,
    min_cluster_share: float | None,
    component: Component,
    middle: NDArray[np.float64],
    notes: list[str],
) -> tuple[Tensor, float]:
    """Which splats (N,) belong to the clusters asked for, numbered by area times opacity from the largest.

    The other number is the width of the widest isolated cluster, the longest side of its box; 0 if there is none.

    Args:
        splats: N splats with finite rows.
        min_cluster_share: clusters of less than this share are isolated and never chosen; None for no limit.
        component: "largest", "all" that are not isolated, "middle" (the nearest to the middle of those with a fifth of
            the largest one's area, with those whose centers lie in its box, as linked rings have them), or an index.
        middle: (3,), of the scene.
        notes: what is dropped is added here, with its count.

    Raises:
        InputError: if there is no such component.
    """
    labels, weights = _clusters(splats), disc_weights(splats).cpu().numpy()
    shares = np.bincount(labels, weights).astype(np.float64)
    order = np.argsort(-shares, kind="stable")
    isolated = shares < (0 if min_cluster_share is None else min_cluster_share)
    isolated[order[0]] = False
    order = order[~isolated[order]]
    if component == "all":
        chosen = order
    elif component == "largest":
        chosen = order[:1]
    elif component == "middle":
        large = order[shares[order] >= _LARGE * shares[order[0]]]
        means = splats.means.detach().double().cpu().numpy()
        centers = np.stack([np.bincount(labels, weights * column) for column in means.T], axis=1) / shares[:, None]
        nearest = large[np.linalg.norm(centers[large] - middle, axis=1).argmin()]
        box = means[labels == nearest]
        within = ((centers[order] >= box.min(0)) & (centers[order] <= box.max(0))).all(1)
        chosen = order[within | (order == nearest)]
    elif isinstance(component, int) and not isinstance(component, bool) and 0 <= component < len(order):
        chosen = order[component : component + 1]
    else:
        raise InputError(
            f"component is {component!r}; expected 'largest', 'middle', 'all' or an index 0 … {len(order) - 1}: there "
            f"are {len(order)} clusters, with {_percentages(shares[order])} of the area."
        )
    stray = isolated[labels]
    elsewhere = ~stray & ~np.isin(labels, chosen)
    if stray.any():
        notes.append(
            f"{int(stray.sum())} of {len(splats)} splats lie in isolated clusters ({int(isolated.sum())}) of less than "
            f"min_cluster_share={min_cluster_share:g} of the area each and were dropped."
        )
    if elsewhere.any():
        notes.append(
            f"{int(elsewhere.sum())} of {len(splats)} splats lie in other clusters ({len(order)} in all, with "
            f"{_percentages(shares[order])} of the area) and were dropped: component={component!r}."
        )
    widths = np.where(isolated, _widths(labels, splats), 0.0)
    return torch.from_numpy(np.isin(labels, chosen)), float(widths.max())


def small_clusters(splats: GaussianSplats, below: float) -> Tensor:
    """Which splats (N,) belong to clusters whose box is shorter than a length along every axis."""
    labels = _clusters(splats)
    return torch.from_numpy((_widths(labels, splats) < below)[labels])


def _widths(labels: NDArray[np.int64], splats: GaussianSplats) -> NDArray[np.float64]:
    """The longest sides of the boxes around clusters (C,), of the labels (N,) of their splats."""
    means = splats.means.detach().double().cpu().numpy()
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order], prepend=-1))
    sizes = np.maximum.reduceat(means[order], starts) - np.minimum.reduceat(means[order], starts)
    widths: NDArray[np.float64] = sizes.max(axis=1)
    return widths


def _percentages(shares: NDArray[np.float64], most: int = 5) -> str:
    listed = ", ".join(f"{100 * share:.3g} %" for share in shares[:most])
    return listed + (" …" if len(shares) > most else "")


def _clusters(splats: GaussianSplats) -> NDArray[np.int64]:
    """Labels (N,) of coherent clusters.

    Every disc marks its center and the four ends of its axes in a grid; cells that touch, and cells of one disc, are
    connected. Unlike a neighbor graph of the centers this connects a large disc to small ones at its rim.
    """
    marks, cell = _disc_marks(splats)
    cells, of_mark = _cells((marks - np.median(marks[:, 0], axis=0)) / cell)
    touching = cKDTree(cells).query_pairs(1.8, output_type="ndarray")  # √3 reaches the corner neighbors
    rows = np.concatenate((touching[:, 0], np.repeat(of_mark[:, 0], 4)))
    columns = np.concatenate((touching[:, 1], of_mark[:, 1:].ravel()))
    labels = connected_labels(len(cells), rows, columns)
    return np.unique(labels[of_mark[:, 0]], return_inverse=True)[1]


def _cells(positions: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Occupied unit cells (C, 3), and the cell of each position (..., 3) as an index (...,).

    A cell is one 64-bit number, 21 bits per axis, because sorting rows would take most of the time. Positions more
    than a million cells away are clipped to that distance.
    """
    most = 1 << 20
    steps = np.clip(np.floor(positions), -most, most - 1).astype(np.int64) + most
    keys, of_place = np.unique(steps[..., 0] << 42 | steps[..., 1] << 21 | steps[..., 2], return_inverse=True)
    cells = np.stack([keys >> shift & (2 * most - 1) for shift in (42, 21, 0)], axis=1)
    return cells, of_place.reshape(positions.shape[:-1])


def _disc_marks(splats: GaussianSplats) -> tuple[NDArray[np.float64], float]:
    """Five points on every disc, (N, 5, 3), and the side of a grid cell."""
    means = splats.means.detach().double().cpu()
    scales = splats.scales.detach().double().cpu()
    axes = rotation_matrices(splats.quaternions.detach().double().cpu()).mT * scales[..., None] * _REACH
    ends = axes.take_along_dim(scales.argsort(-1)[:, 1:, None], dim=1)  # (N, 2, 3), without the smallest
    marks = torch.cat((means[:, None], means[:, None] + ends, means[:, None] - ends), dim=1)
    return marks.numpy(), float(_LINK * scales.amax(-1).median())
