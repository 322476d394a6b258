"""Coherent clusters of discs, and the choice of one."""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.adapters.splats.gaussians import GaussianSplats
from topokit.adapters.splats.geometry import disc_weights, rotation_matrices
from topokit.core.labels import connected_labels
from topokit.errors import InputError

Component = Literal["largest", "all"] | int
_REACH = 1.5  # standard deviations, radius of a disc when clusters are formed
_LINK = 2.0  # cells of the cluster grid per median size


def choose_clusters(
    splats: GaussianSplats, min_cluster_share: float | None, component: Component, notes: list[str]
) -> GaussianSplats:
    """The splats of the clusters asked for, numbered by area times opacity from the largest.

    Args:
        splats: N splats with finite rows.
        min_cluster_share: clusters of less than this share are isolated and never chosen; None for no limit.
        component: "largest", "all" that are not isolated, or an index.
        notes: what is dropped is added here, with its count.

    Raises:
        InputError: if there is no such component.
    """
    labels = _clusters(splats)
    shares = np.bincount(labels, disc_weights(splats).cpu().numpy()).astype(np.float64)
    order = np.argsort(-shares, kind="stable")
    isolated = shares < (0 if min_cluster_share is None else min_cluster_share)
    isolated[order[0]] = False
    order = order[~isolated[order]]
    if component == "all":
        chosen = order
    elif component == "largest":
        chosen = order[:1]
    elif isinstance(component, int) and not isinstance(component, bool) and 0 <= component < len(order):
        chosen = order[component : component + 1]
    else:
        raise InputError(
            f"component is {component!r}; expected 'largest', 'all' or an index 0 … {len(order) - 1}: there are "
            f"{len(order)} clusters, with {_percentages(shares[order])} of the area."
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
    kept = torch.from_numpy(np.flatnonzero(np.isin(labels, chosen)))
    return splats if len(kept) == len(splats) else splats[kept.to(splats.means.device)]


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
