"""Filters that leave the surface of a scene: by opacity, size and flatness, then by cluster."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.adapters.splats.clusters import Component, choose_clusters
from topokit.adapters.splats.gaussians import GaussianSplats
from topokit.adapters.splats.geometry import disc_areas, thickness
from topokit.errors import InputError, Option


@dataclass(frozen=True)
class Limits:
    """Limits of the filters; None switches a filter off. See `topokit.from_splats`.

    Raises:
        InputError: if a share is outside 0 … 1, or the ratio of sizes below 1.
    """

    min_opacity: float | None
    max_size_ratio: float | None
    max_thickness_ratio: float | None
    min_cluster_share: float | None

    def __post_init__(self) -> None:
        for name in ("min_opacity", "max_thickness_ratio", "min_cluster_share"):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= 1:
                raise InputError(f"{name} is {value}; expected a share 0 … 1, or None to switch it off.")
        if self.max_size_ratio is not None and not self.max_size_ratio >= 1:
            raise InputError(
                f"max_size_ratio is {self.max_size_ratio}; expected at least 1 (times the median), or None to switch "
                "it off."
            )


@dataclass(frozen=True)
class Kept:
    """The splats that passed the filters.

    Attributes:
        splats: the splats kept, differentiable in the ones given.
        is_flat: whether at least half of them are discs, so that their rotations give normals.
        notes: a sentence for everything that was dropped, with its count.
    """

    splats: GaussianSplats
    is_flat: bool
    notes: tuple[str, ...]


Why = tuple[str | Option, ...]


def clean(splats: GaussianSplats, limits: Limits, component: Component) -> Kept:
    """Drop what is not surface and choose a cluster. The splats stay differentiable, the choice is not.

    Raises:
        InputError: if nothing is left, most rows are broken, or there is no such component.
    """
    notes: list[str] = []
    splats = _without_broken(splats, notes)
    if limits.min_opacity is not None:
        faint = splats.opacities < limits.min_opacity
        why: Why = "are fainter than ", Option("min_opacity", f"{limits.min_opacity:g}")
        splats = _drop(splats, faint, why, notes)
    if limits.max_size_ratio is not None:
        size = splats.scales.detach().amax(-1)
        huge = size > limits.max_size_ratio * size.median()
        why = "are larger than ", Option("max_size_ratio", f"{limits.max_size_ratio:g}"), " times the median"
        splats = _drop(splats, huge, why, notes)
    is_flat = True
    if limits.max_thickness_ratio is not None:
        splats, is_flat = _without_thick(splats, limits.max_thickness_ratio, notes)
    return Kept(choose_clusters(splats, limits.min_cluster_share, component, notes), is_flat, tuple(notes))


def _without_thick(splats: GaussianSplats, max_ratio: float, notes: list[str]) -> tuple[GaussianSplats, bool]:
    """The discs, or all splats where most are blobs; and whether they are discs."""
    thick = thickness(splats) > max_ratio
    why: Why = "are thicker than ", Option("max_thickness_ratio", f"{max_ratio:g}")
    if 2 * int(thick.sum()) <= len(splats):
        return _drop(splats, thick, why, notes), True
    notes.append(
        f"{int(thick.sum())} of {len(splats)} splats {_said(why)}: most are blobs, not discs. They were kept; their "
        "rotations give no normals, which are estimated from the samples instead."
    )
    return splats, False


def _without_broken(splats: GaussianSplats, notes: list[str]) -> GaussianSplats:
    parts = (splats.means, splats.scales, splats.quaternions, splats.opacities[:, None])
    sound = torch.cat([part.detach() for part in parts], dim=1).isfinite().all(-1)
    sound &= (splats.quaternions.detach() != 0).any(-1) & (disc_areas(splats) > 0)
    n_broken = len(splats) - int(sound.sum())
    if 2 * n_broken > len(splats) or len(splats) == 0:
        raise InputError(
            f"{n_broken} of {len(splats)} splats are NaN, infinite, without rotation or of no area. "
            "More than half of the scene is invalid: keep the valid rows yourself if you want to use them."
        )
    return _drop(splats, ~sound, ("are NaN, infinite, without rotation or of no area",), notes)


def _drop(splats: GaussianSplats, dropped: Tensor, why: Why, notes: list[str]) -> GaussianSplats:
    n_dropped = int(dropped.sum())
    if n_dropped == 0:
        return splats
    if n_dropped == len(splats):
        left = ": nothing is left. Relax that limit, or pass None to skip it."
        raise InputError(f"all {n_dropped} splats ", *why, left)
    notes.append(f"{n_dropped} of {len(splats)} splats {_said(why)} and were dropped.")
    return splats[~dropped]


def _said(why: Why) -> str:
    return "".join(map(str, why))
