"""Gaussian splats as a shape: cleaned, then sampled on their discs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor

from topokit.adapters.splats.cleaning import Limits, clean
from topokit.adapters.splats.clusters import Component
from topokit.adapters.splats.discs import sample_discs
from topokit.adapters.splats.gaussians import GaussianSplats
from topokit.core.local.curvature import DEFAULT_NEIGHBORS
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.shape import Shape

_FEWEST_SAMPLES, _MOST_SAMPLES = 5_000, 20_000


def from_splats(
    source: str | os.PathLike[str] | GaussianSplats | Mapping[str, Tensor] | torch.nn.ParameterDict,
    *,
    component: Component = "all",
    min_opacity: float | None = 0.1,
    max_size: float | None = 10.0,
    max_thickness: float | None = 0.5,
    min_cluster: float | None = 0.01,
    n_samples: int | None = None,
    n_neighbors: int = DEFAULT_NEIGHBORS,
    generator: torch.Generator | None = None,
) -> Shape:
    """Gaussian splats as a shape of samples on their discs.

    Normals are the axes of the smallest scales (stored normals are zeros and never looked at); their signs are
    unknown. Everything that is dropped is counted in the shape's notes, which become reasons of its report.

    Args:
        source: a path (.ply .splat .spz .sog .ksplat, or the folder of an unzipped .sog), a `GaussianSplats`, or a
            dictionary as gsplat's trainer stores it (see `GaussianSplats.from_dict`). Tensors keep dtype, device and
            gradient; files are sampled in float64.
        component: "all" keeps every cluster that is not isolated, "largest" the one with most area, an
            index chooses one, counted by area from 0. Clusters are as coherent as the discs are large: gaps below
            about two median disc sizes do not part them.
        min_opacity: fainter splats are dropped. None switches this and each of the following three off.
        max_size: splats whose largest scale exceeds this many medians are dropped (background, sky).
        max_thickness: splats whose smallest scale exceeds this share of the middle one are dropped: they have no
            normal to speak of. If that is most of the scene, all are kept and normals are estimated from the samples.
        min_cluster: clusters with less than this share of the area are dropped (floaters).
        n_samples: points on the discs, spread by area times opacity. By default as many as splats are kept, but at
            least 5 000 and at most 20 000: several samples on one disc add coverage, but no curvature.
        n_neighbors: k of the local half.
        generator: source of randomness (CPU); seed 0 if None.

    Returns:
        A `Shape`, differentiable in means, scales and quaternions: samples move with their splats. Which splats are
        kept, and how many samples each gets, is not differentiable.

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
        >>> round(float(tk.from_splats(splats).euler()))
        2
    """
    _check_limits(min_opacity, max_size, max_thickness, min_cluster)
    if n_samples is not None and n_samples <= n_neighbors:
        raise InputError(f"n_samples is {n_samples}; it must be larger than n_neighbors, which is {n_neighbors}.")
    name, splats = _open(source)
    kept = clean(splats, Limits(min_opacity, max_size, max_thickness, min_cluster), component)
    if n_samples is None:
        n_samples = min(max(len(kept.splats), _FEWEST_SAMPLES), _MOST_SAMPLES)
    on_discs = sample_discs(kept.splats, n_samples, generator)
    samples = SurfaceSamples(on_discs.points, frames=on_discs.frames if kept.is_flat else None, oriented=False)
    summary = f"{n_samples} samples lie on the discs of {len(kept.splats)} of {len(splats)} splats."
    return Shape(samples, name=name, notes=(*kept.notes, summary), n_neighbors=n_neighbors)


def _open(source: object) -> tuple[str, GaussianSplats]:
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        name = path.parent.name if path.name == "meta.json" else path.name
        return name or "splats", GaussianSplats.from_file(path).to(torch.float64)
    if isinstance(source, GaussianSplats):
        return "splats", source
    if isinstance(source, Mapping | torch.nn.ParameterDict):
        return "splats", GaussianSplats.from_dict(source)
    raise InputError(
        f"from_splats got {type(source).__name__}; expected a path, a GaussianSplats or a dictionary of tensors."
    )


def _check_limits(
    min_opacity: float | None, max_size: float | None, max_thickness: float | None, min_cluster: float | None
) -> None:
    shares = {"min_opacity": min_opacity, "max_thickness": max_thickness, "min_cluster": min_cluster}
    for name, value in shares.items():
        if value is not None and not 0 <= value <= 1:
            raise InputError(f"{name} is {value}; expected a share 0 … 1, or None to switch it off.")
    if max_size is not None and not max_size >= 1:
        raise InputError(f"max_size is {max_size}; expected at least 1 (times the median), or None to switch it off.")
