"""What of a scene is surface: filters by opacity, size and flatness, then the choice of a coherent cluster."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.adapters.splats.clusters import Component, choose_clusters
from topokit.adapters.splats.gaussians import GaussianSplats
from topokit.adapters.splats.geometry import disc_areas, thickness
from topokit.errors import InputError


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
    return Kept(choose_clusters(splats, limits.min_cluster, component, notes), is_flat, tuple(notes))


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
