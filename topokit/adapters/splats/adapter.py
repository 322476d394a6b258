"""Gaussian splats as a shape: cleaned, then sampled on their discs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from topokit.adapters.splats.absorption import gaussians_of
from topokit.adapters.splats.cleaning import Kept, Limits, check_share, clean, discs_of
from topokit.adapters.splats.clusters import Component
from topokit.adapters.splats.disc_samples import sample_discs
from topokit.adapters.splats.gaussians import GaussianSplats
from topokit.core.draws import check_sample_count, deferred_seed
from topokit.core.local.neighborhood_size import given_or_default
from topokit.core.opacity.scene import AbsorbingScene
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.inputs.calls import options_by_name
from topokit.inputs.remote import takes_addresses
from topokit.shape import Shape

_OBJECT_ALONE = (
    "If the splats are a scene, ask for the object alone: from_splats(object=True), or topokit report --object."
)


@options_by_name("object")
@takes_addresses()
def from_splats(
    source: str | os.PathLike[str] | GaussianSplats | Mapping[str, Tensor] | torch.nn.ParameterDict,
    *,
    activated: bool = False,
    object: bool = False,
    component: Component | None = None,
    surroundings: bool | None = None,
    min_opacity: float | None = 0.1,
    max_size_ratio: float | None = 10.0,
    max_thickness_ratio: float | None = 0.5,
    min_cluster_share: float | None = 0.01,
    n_samples: int | None = None,
    n_neighbors: int | None = None,
    generator: torch.Generator | None = None,
) -> Shape:
    """Gaussian splats as a shape of samples on their discs.

    Normals are the axes of the smallest scales; their signs are unknown. (Stored normals are zeros and are ignored.)
    Everything that is dropped is counted in the shape's notes, which become reasons of its report.

    Args:
        source: a path (.ply .splat .spz .sog .ksplat, or the folder of an unzipped .sog), a `GaussianSplats`, or a
            dictionary or loaded checkpoint of gsplat, nerfstudio or INRIA's trainer (see `GaussianSplats.from_dict`).
            Tensors keep dtype, device and gradient; files are sampled in float64.
        activated: for dictionaries: False for what a trainer stores (log scales, logit opacities), True for linear
            scales and opacities 0 … 1.
        object: whether to keep the object in the middle alone, as `GaussianSplats.object` does. It changes the defaults
            of the next two arguments, each of which switches its step off again.
        component: "all" keeps every cluster that is not isolated, "largest" the one with most area, "middle" the
            nearest to the middle of the scene (of those with a fifth of the largest one's area) with those whose
            centers lie in its box; an index chooses one, counted by area from 0. Gaps below about two median disc sizes
            do not separate clusters. None is "all", and "middle" of an object.
        surroundings: whether planes on or before which an object stands (table, floor, walls) are cut off with all
            that is behind them. None does so of an object only.
        min_opacity: splats of lower opacity are dropped. None switches this and each of the following three off.
        max_size_ratio: splats whose largest scale exceeds the median of the scene this many times are dropped
            (background, sky).
        max_thickness_ratio: splats whose smallest scale exceeds this fraction of their middle scale are dropped: they
            are blobs without a normal. If that is most of the scene, all are kept and normals are estimated from the
            samples.
        min_cluster_share: clusters with less than this share of the scene's area are dropped (floaters). Of all
            clusters, without a choice among them, the report is unsure if one that was dropped is as wide as its
            resolution.
        n_samples: None takes one sample near the mean of every splat that is kept. A number of points is spread over
            the discs by area times opacity; gaps between discs then look like holes if there are more than splats.
        n_neighbors: number of nearest neighbors for curvature; None takes 20, or more where the samples are noisy.
        generator: source of randomness (CPU), advanced by one draw; seed 0 if None.

    Returns:
        A `Shape`, differentiable in means, scales and quaternions: samples move with their splats. Which splats are
        kept, and how many samples each gets, is not differentiable. Opacities have a gradient only by `euler()`, and
        only where opacity decides the integer; `GaussianSplats.optical_depth` always has one to them.

    Raises:
        ReadError: if the file is missing or malformed.
        UnknownFormatError: if it is no splat file.
        InputError: on wrong shapes or limits, if nothing is left after cleaning, or if there is no such component.

    Example:
        >>> import topokit as tk, torch
        >>> ball = torch.randn(2000, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
        >>> ball = ball / ball.norm(dim=-1, keepdim=True)
        >>> quaternions = torch.stack((1 + ball[:, 2], -ball[:, 1], ball[:, 0], torch.zeros(2000).double()), dim=-1)
        >>> scales = torch.tensor([0.05, 0.05, 0.001], dtype=torch.float64).expand(2000, 3)
        >>> splats = tk.GaussianSplats(ball, scales, quaternions, torch.ones(2000).double())
        >>> round(float(tk.from_splats(splats).gauss_bonnet()))
        2
    """
    chosen, cuts = _steps(object, component, surroundings)
    limits = Limits(min_opacity, max_size_ratio, min_cluster_share, chosen, cuts)
    check_share("max_thickness_ratio", max_thickness_ratio)
    if n_samples is not None:
        check_sample_count(n_samples, given_or_default(n_neighbors))
    name, splats = _open(source, activated)
    solid = clean(splats, limits)
    kept = discs_of(solid, max_thickness_ratio)
    seed = deferred_seed(generator)
    summary = f"{n_samples or len(kept.splats)} samples lie on the discs of {len(kept.splats)} of {len(splats)} splats."
    notes = (*kept.notes, summary)
    advice = None if object or component is not None else _OBJECT_ALONE
    return Shape(
        lambda: _samples(kept, n_samples, seed),
        opacity=AbsorbingScene(partial(gaussians_of, solid.splats)),
        left_out=kept.widest_floater if chosen == "all" else 0.0,
        name=name,
        notes=notes,
        n_neighbors=n_neighbors,
        advice=advice,
    )


def write_kept(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    object: bool = False,
    component: Component | None = None,
    surroundings: bool | None = None,
    min_opacity: float | None = 0.1,
    max_size_ratio: float | None = 10.0,
    min_cluster_share: float | None = 0.01,
    page: str | os.PathLike[str] | None = None,
) -> tuple[str, ...]:
    """Write the splats of a file that `from_splats` keeps, but for those that have no normal, in its format.

    Args:
        source: a .ply, .splat or .spz file; see `Kept.save`.
        target: file to write.
        object: as for `from_splats`, likewise the following.
        component: of the clusters.
        surroundings: whether planes are cut off.
        min_opacity: limit of haze.
        max_size_ratio: limit of background.
        min_cluster_share: limit of floaters.
        page: an HTML file to write, too; see `Kept.save_html`.

    Returns:
        A sentence for everything that was dropped, with its count, and one for what was kept.
    """
    scene = GaussianSplats.from_file(source)
    chosen, cuts = _steps(object, component, surroundings)
    kept = clean(scene, Limits(min_opacity, max_size_ratio, min_cluster_share, chosen, cuts))
    kept.save(target, like=source)
    if page is not None:
        kept.save_html(page, scene)
    return *kept.notes, f"{len(kept)} of {len(scene)} splats were kept."


def _steps(object: bool, component: Component | None, surroundings: bool | None) -> tuple[Component, bool]:
    """Which component is kept, and whether planes are cut off: as given, else as an object or a whole scene needs."""
    chosen: Component = component if component is not None else "middle" if object else "all"
    return chosen, object if surroundings is None else surroundings


def _samples(kept: Kept, count: int | None, seed: int) -> SurfaceSamples:
    on_discs = sample_discs(kept.splats, count, torch.Generator().manual_seed(seed))
    return SurfaceSamples(on_discs.points, frames=on_discs.frames if kept.is_flat else None, oriented=False)


def _open(source: Any, activated: bool) -> tuple[str, GaussianSplats]:
    if isinstance(source, Mapping | torch.nn.ParameterDict):
        return "splats", GaussianSplats.from_dict(source, activated=activated)
    if activated:
        raise InputError(
            f"activated=True is for dictionaries of tensors, but from_splats got {type(source).__name__}: leave it out."
        )
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        name = path.parent.name if path.name == "meta.json" else path.name
        return name or "splats", GaussianSplats.from_file(path).to(torch.float64)
    if isinstance(source, GaussianSplats):
        return "splats", source
    raise InputError(
        f"from_splats got {type(source).__name__}; expected a path, a GaussianSplats or a dictionary of tensors."
    )
