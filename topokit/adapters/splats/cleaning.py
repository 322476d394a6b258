"""What of a scene is surface: filters by opacity, size and flatness, and the choice of a coherent cluster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.adapters.splats.gaussians import GaussianSplats, rotation_matrices
from topokit.errors import InputError

Component = Literal["largest", "all"] | int
_REACH = 1.5  # standard deviations over which a disc counts as there when clusters are looked for
_LINK = 2.0  # cells of the cluster grid per median size


@dataclass(frozen=True)
class Limits:
    """What is kept; None switches a filter off. See `topokit.from_splats`."""

    min_opacity: float | None
    max_size: float | None
    max_thickness: float | None
    min_cluster: float | None


@dataclass(frozen=True)
class Kept:
    """What the cleaning left.

    Attributes:
        splats: the splats kept, differentiable in the ones given.
        is_flat: whether enough of them are discs for their rotations to be believed.
        notes: a sentence for everything that was dropped, with its count.
    """

    splats: GaussianSplats
    is_flat: bool
    notes: tuple[str, ...]


def clean(splats: GaussianSplats, limits: Limits, component: Component) -> Kept:
    """Drop what is no surface and choose a cluster. Which splats are kept is not differentiable; the splats are.

    Raises:
        InputError: if nothing is left, most rows are broken, or there is no such component.
    """
    notes: list[str] = []
    splats = _without_broken(splats, notes)
    if limits.min_opacity is not None:
        faint = splats.opacities < limits.min_opacity
        splats = _drop(splats, faint, f"are fainter than min_opacity={limits.min_opacity:g}", notes)
    if limits.max_size is not None:
        size = splats.scales.detach().amax(-1)
        huge = size > limits.max_size * size.median()
        splats = _drop(splats, huge, f"are larger than max_size={limits.max_size:g} times the median", notes)
    is_flat = True
    if limits.max_thickness is not None:
        thick = thickness(splats) > limits.max_thickness
        is_flat = 2 * int(thick.sum()) <= len(splats)
        if is_flat:
            splats = _drop(splats, thick, f"are thicker than max_thickness={limits.max_thickness:g}", notes)
        else:
            notes.append(
                f"{int(thick.sum())} of {len(splats)} splats are thicker than max_thickness={limits.max_thickness:g}: "
                "most are blobs, not discs. They were kept; their rotations say nothing about normals, which are "
                "estimated from the samples instead."
            )
    return Kept(_choose(splats, limits.min_cluster, component, notes), is_flat, tuple(notes))


def thickness(splats: GaussianSplats) -> Tensor:
    """Smallest over middle scale, (N,), 0 for a disc and 1 for a ball or a needle; detached."""
    ordered = splats.scales.detach().sort(dim=-1).values
    return ordered[:, 0] / ordered[:, 1]


def disc_areas(splats: GaussianSplats) -> Tensor:
    """Product of the two larger scales, (N,); detached."""
    ordered = splats.scales.detach().sort(dim=-1).values
    return ordered[:, 1] * ordered[:, 2]


def disc_weights(splats: GaussianSplats) -> Tensor:
    """Area times opacity as shares of the whole, (N,), float64; detached.

    Raises:
        InputError: if every splat is fully transparent.
    """
    areas = disc_areas(splats).double()
    weights = areas / areas.max() * splats.opacities.detach()
    if not bool(weights.sum() > 0):
        raise InputError(f"all {len(splats)} splats have opacity 0: there is no surface to sample.")
    return weights / weights.sum()


def _without_broken(splats: GaussianSplats, notes: list[str]) -> GaussianSplats:
    parts = (splats.means, splats.scales, splats.quaternions, splats.opacities[:, None])
    sound = torch.cat([part.detach() for part in parts], dim=1).isfinite().all(-1)
    sound &= (splats.quaternions.detach() != 0).any(-1) & (disc_areas(splats) > 0)
    n_broken = len(splats) - int(sound.sum())
    if 2 * n_broken > len(splats) or len(splats) == 0:
        raise InputError(
            f"{n_broken} of {len(splats)} splats are NaN, infinite, without rotation or of no area. "
            "A scene of which most is missing is refused: keep the sound rows yourself if they are what you mean."
        )
    return _drop(splats, ~sound, "are NaN, infinite, without rotation or of no area", notes)


def _drop(splats: GaussianSplats, dropped: Tensor, why: str, notes: list[str]) -> GaussianSplats:
    n_dropped = int(dropped.sum())
    if n_dropped == 0:
        return splats
    if n_dropped == len(splats):
        raise InputError(f"all {n_dropped} splats {why}: nothing is left. Relax that limit, or pass None to skip it.")
    notes.append(f"{n_dropped} of {len(splats)} splats {why} and were dropped.")
    return splats.select(~dropped)


def _choose(
    splats: GaussianSplats, min_cluster: float | None, component: Component, notes: list[str]
) -> GaussianSplats:
    """The splats of the clusters asked for; clusters are numbered by weight, largest first."""
    labels = _clusters(splats)
    shares = np.bincount(labels, disc_weights(splats).cpu().numpy()).astype(np.float64)
    order = np.argsort(-shares, kind="stable")
    isolated = shares < (0 if min_cluster is None else min_cluster)
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
            f"min_cluster={min_cluster:g} of the area each and were dropped."
        )
    if elsewhere.any():
        notes.append(
            f"{int(elsewhere.sum())} of {len(splats)} splats lie in other clusters ({len(order)} in all, with "
            f"{_percentages(shares[order])} of the area) and were dropped: component={component!r}."
        )
    kept = torch.from_numpy(np.flatnonzero(np.isin(labels, chosen)))
    return splats if len(kept) == len(splats) else splats.select(kept.to(splats.means.device))


def _percentages(shares: NDArray[np.float64], most: int = 5) -> str:
    listed = ", ".join(f"{100 * share:.3g} %" for share in shares[:most])
    return listed + (" …" if len(shares) > most else "")


def _clusters(splats: GaussianSplats) -> NDArray[np.int64]:
    """Labels (N,) of coherent clusters.

    Every disc is marked by its centre and the four ends of its axes in a grid; cells that touch, and cells of one
    disc, belong together. Unlike the neighbour graph of the centres this does not mind a large disc among small ones.
    """
    marks, cell = _disc_marks(splats)
    cells, of_mark = _cells((marks - np.median(marks[:, 0], axis=0)) / cell)
    touching = cKDTree(cells).query_pairs(1.8, output_type="ndarray")  # √3 reaches the corner neighbours
    rows = np.concatenate((touching[:, 0], np.repeat(of_mark[:, 0], 4)))
    columns = np.concatenate((touching[:, 1], of_mark[:, 1:].ravel()))
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(len(cells), len(cells)))
    _, labels = connected_components(graph, directed=False)
    return np.unique(labels[of_mark[:, 0]], return_inverse=True)[1]


def _cells(places: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Occupied unit cells (C, 3) and which of them each place (..., 3) is in: (...,).

    A cell is one 64-bit number, 21 bits per axis, because sorting rows would take most of the time. What is farther
    than a million cells away is counted at that distance.
    """
    most = 1 << 20
    steps = np.clip(np.floor(places), -most, most - 1).astype(np.int64) + most
    keys, of_place = np.unique(steps[..., 0] << 42 | steps[..., 1] << 21 | steps[..., 2], return_inverse=True)
    cells = np.stack([keys >> shift & (2 * most - 1) for shift in (42, 21, 0)], axis=1)
    return cells, of_place.reshape(places.shape[:-1])


def _disc_marks(splats: GaussianSplats) -> tuple[NDArray[np.float64], float]:
    """Five points (N, 5, 3) on every disc, and the side of a grid cell."""
    means = splats.means.detach().double().cpu()
    scales = splats.scales.detach().double().cpu()
    axes = rotation_matrices(splats.quaternions.detach().double().cpu()).mT * scales[..., None] * _REACH
    ends = axes.take_along_dim(scales.argsort(-1)[:, 1:, None], dim=1)  # (N, 2, 3), without the smallest
    marks = torch.cat((means[:, None], means[:, None] + ends, means[:, None] - ends), dim=1)
    return marks.numpy(), float(_LINK * scales.amax(-1).median())
