"""Filters that leave the surface of a scene: by opacity and size, by planes around it, by cluster, then by flatness."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from topokit.adapters.splats.clusters import Component, choose_clusters, small_clusters
from topokit.adapters.splats.disc_sizes import disc_areas, disc_weights, thickness
from topokit.adapters.splats.formats.copy_rows import copy_rows
from topokit.adapters.splats.normals import normals_of
from topokit.adapters.splats.surrounding_planes import Plane, surrounding_planes
from topokit.errors import InputError, Option

if TYPE_CHECKING:
    from topokit.adapters.splats.gaussians import GaussianSplats


_FEWEST = 100  # splats before a plane of the surroundings, at least: fewer are no object, and the plane may be its top


@dataclass(frozen=True)
class Limits:
    """Limits of the filters; None switches a filter off. See `topokit.from_splats`.

    Raises:
        InputError: if a share is outside 0 … 1, or the ratio of sizes below 1.
    """

    min_opacity: float | None
    max_size_ratio: float | None
    min_cluster_share: float | None
    component: Component = "all"
    surroundings: bool = False

    def __post_init__(self) -> None:
        for name in ("min_opacity", "min_cluster_share"):
            check_share(name, getattr(self, name))
        if self.max_size_ratio is not None and not self.max_size_ratio >= 1:
            raise InputError(
                f"max_size_ratio is {self.max_size_ratio}; expected at least 1 (times the median), or None to switch "
                "it off."
            )


def check_share(name: str, value: float | None) -> None:
    """An `InputError` if a limit that is a share is outside 0 … 1."""
    if value is not None and not 0 <= value <= 1:
        raise InputError(f"{name} is {value}; expected a share 0 … 1, or None to switch it off.")


@dataclass(frozen=True, eq=False)
class Kept:
    """The splats that passed the filters.

    Attributes:
        splats: the M splats kept, differentiable in the ones given.
        rows: (M,) their indices in the scene.
        notes: a sentence for everything that was dropped, with its count.
        is_flat: whether at least half of them are discs, so that their rotations give normals.
        planes: the planes of the surroundings that were cut off.
        widest_floater: longest side of the box of the widest isolated cluster that was dropped, in units of the means;
            0 if there was none.
    """

    splats: GaussianSplats
    rows: Tensor
    notes: tuple[str, ...] = ()
    is_flat: bool = True
    planes: tuple[Plane, ...] = ()
    widest_floater: float = 0.0

    def __len__(self) -> int:
        return len(self.rows)

    def save(self, target: str | os.PathLike[str], *, like: str | os.PathLike[str]) -> None:
        """Write these splats of the file that the scene was read from, with its colors and all other columns.

        Args:
            target: file to write, in the format of the other one.
            like: the .ply, .splat or .spz file (version 1 to 3) of the scene. `GaussianSplats.to_ply` writes splats of
                any origin without colors.

        Raises:
            InputError: if the target has another suffix, its folder does not exist, or the file has fewer splats.
            UnknownFormatError: if the splats of the file cannot be taken apart without loss.
        """
        copy_rows(like, self.rows.cpu().numpy(), target)

    def save_html(self, path: str | os.PathLike[str], scene: GaussianSplats) -> None:
        """Write a page with the scene in 3D, kept splats and removed ones in two colors, and what each step did.

        Args:
            path: file to write, called .html or .htm.
            scene: the splats that these were chosen from; of rows that are not finite nothing is drawn.

        Raises:
            InputError: if the file is called otherwise, or its folder does not exist.
        """
        from topokit.pages.kept import save_kept_page

        is_kept = torch.zeros(len(scene), dtype=torch.bool)
        is_kept[self.rows.cpu()] = True
        finite = scene.means.detach().isfinite().all(1) & scene.scales.detach().isfinite().all(1)
        finite &= scene.quaternions.detach().isfinite().all(1)
        drawn = scene[finite]
        axes = normals_of(drawn.scales, torch.nn.functional.normalize(drawn.quaternions, dim=1)).detach()
        notes = (*self.notes, f"{len(self)} of {len(scene)} splats were kept.")
        positions, normals = (part.cpu().double().numpy() for part in (drawn.means.detach(), axes))
        save_kept_page(path, "splats", positions, normals, is_kept[finite.cpu()].numpy(), notes)

    def chosen(self, mask: Tensor, *notes: str) -> Kept:
        """Those of a mask (M,), with more notes."""
        if bool(mask.all()):
            return self
        mask = mask.to(self.rows.device)
        return replace(self, splats=self.splats[mask], rows=self.rows[mask], notes=self.notes + notes)

    def without(self, dropped: Tensor, why: Why) -> Kept:
        """Those that are not in a mask (M,), and how many are.

        Raises:
            InputError: if nothing is left.
        """
        n_dropped = int(dropped.sum())
        if n_dropped == len(self):
            left = ": nothing is left. Relax that limit, or pass None to skip it."
            raise InputError(f"all {n_dropped} splats ", *why, left)
        return self.chosen(~dropped, f"{n_dropped} of {len(self)} splats {_said(why)} and were dropped.")


Why = tuple[str | Option, ...]


def clean(splats: GaussianSplats, limits: Limits) -> Kept:
    """Drop what is not surface and choose a cluster. The splats stay differentiable, the choice is not.

    Raises:
        InputError: if nothing is left, most rows are broken, or there is no such component.
    """
    kept = _without_broken(Kept(splats, torch.arange(len(splats), device=splats.means.device)))
    if limits.min_opacity is not None:
        faint = kept.splats.opacities < limits.min_opacity
        kept = kept.without(faint, ("are fainter than ", Option("min_opacity", f"{limits.min_opacity:g}")))
    if limits.max_size_ratio is not None:
        size = kept.splats.scales.detach().amax(-1)
        huge = size > limits.max_size_ratio * size.median()
        ratio = Option("max_size_ratio", f"{limits.max_size_ratio:g}")
        kept = kept.without(huge, ("are larger than ", ratio, " times the median"))
    middle = _weighted_median(kept.splats)
    if limits.surroundings:
        kept = _without_surroundings(kept)
    notes: list[str] = []
    mask, widest = choose_clusters(kept.splats, limits.min_cluster_share, limits.component, middle, notes)
    return replace(kept.chosen(mask, *notes), widest_floater=widest)


def without_floaters(splats: GaussianSplats, below: float) -> Kept:
    """The splats without clusters smaller than a length; see `GaussianSplats.simplify`."""
    if not 0 < below < math.inf:
        raise InputError(f"below is {below!r}; a positive length in units of the means was expected.")
    kept = _without_broken(Kept(splats, torch.arange(len(splats), device=splats.means.device)))
    floaters = small_clusters(kept.splats, below).to(kept.rows.device)
    return kept.without(floaters, (f"lie in clusters smaller than {below:g}",)) if floaters.any() else kept


def _weighted_median(splats: GaussianSplats) -> NDArray[np.float64]:
    """The place (3,) that halves the area along each axis: what a scene shows most is around it."""
    means, weights = splats.means.detach().double().cpu().numpy(), disc_weights(splats).cpu().numpy()
    order = means.argsort(axis=0)
    half = (weights[order].cumsum(0) < 0.5).sum(0).clip(max=len(means) - 1)
    return np.take_along_axis(means, np.take_along_axis(order, half[None], axis=0), axis=0)[0]


def _without_surroundings(kept: Kept) -> Kept:
    """The splats before all planes of the surroundings."""
    for plane in surrounding_planes(kept.splats):
        beyond = plane.beyond(kept.splats.means.detach().double().cpu().numpy())
        if len(beyond) - int(beyond.sum()) < _FEWEST:  # no object stands before it, so it surrounds none
            continue
        normal = ", ".join(f"{value + 0.0:.2f}" for value in plane.normal)
        why = (
            f"lie on or behind a plane of the surroundings with {plane.share:.0%} of the area (normal ({normal}), "
            f"offset {plane.offset:.3g}; surroundings=False keeps them)"
        )
        kept = replace(kept.without(torch.from_numpy(beyond), (why,)), planes=(*kept.planes, plane))
    return kept


def discs_of(kept: Kept, max_ratio: float | None) -> Kept:
    """The discs, or all splats where most are blobs; None keeps all."""
    if max_ratio is None:
        return kept
    thick = thickness(kept.splats) > max_ratio
    why: Why = "are thicker than ", Option("max_thickness_ratio", f"{max_ratio:g}")
    if 2 * int(thick.sum()) <= len(kept):
        return kept.without(thick, why)
    note = (
        f"{int(thick.sum())} of {len(kept)} splats {_said(why)}: most are blobs, not discs. They were kept; their "
        "rotations give no normals, which are estimated from the samples instead."
    )
    return replace(kept, is_flat=False, notes=(*kept.notes, note))


def _without_broken(kept: Kept) -> Kept:
    splats = kept.splats
    parts = (splats.means, splats.scales, splats.quaternions, splats.opacities[:, None])
    sound = torch.cat([part.detach() for part in parts], dim=1).isfinite().all(-1)
    sound &= (splats.quaternions.detach() != 0).any(-1) & (disc_areas(splats) > 0)
    n_broken = len(splats) - int(sound.sum())
    if 2 * n_broken > len(splats) or len(splats) == 0:
        raise InputError(
            f"{n_broken} of {len(splats)} splats are NaN, infinite, without rotation or of no area. "
            "More than half of the scene is invalid: keep the valid rows yourself if you want to use them."
        )
    return kept.without(~sound, ("are NaN, infinite, without rotation or of no area",))


def _said(why: Why) -> str:
    return "".join(map(str, why))
