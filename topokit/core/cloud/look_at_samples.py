"""A look at samples of a large cloud, at more of them where their votes differ, or at shifted ones."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.dense import SAMPLES, DenseCloud
from topokit.core.cloud.findings import Signs
from topokit.core.cloud.look import Cloud, Look
from topokit.core.cloud.look_at_all import SOURCES, widened_look
from topokit.core.cloud.more_samples import MoreSamples, more_samples
from topokit.core.cloud.neighborhoods import LocalGeometry, local_geometry, typical_and_finest
from topokit.core.cloud.orientation import Orientation, compare_normals, orient_by_patches
from topokit.core.cloud.votes import coarse_samples, cut_votes, gather_dense_votes, tally
from topokit.core.progress import begin

Floats = NDArray[np.float64]

_SHOWS_A_SURFACE = 0.5  # coverage of a large cloud's samples below which no other samples of it show a surface


def look_at_samples(dense: DenseCloud, cloud: Cloud) -> Look:
    """A look at a large cloud: normals come from all of its points, cuts are made of samples.

    Args:
        dense: the cloud's points with their axes and signs.
        cloud: the same cloud; it says whether normals were given.
    """
    begin("samples")
    samples = dense.samples(SAMPLES)
    kept = samples.kept
    points, axes = dense.points[kept], dense.propagation.normals[kept]
    with ThreadPoolExecutor(1) as thread:
        few = thread.submit(coarse_samples, dense, len(kept) // 2)  # needs no signs, and Qhull no interpreter
        local = local_geometry(points, samples.areas, axes)
        begin("orientation")
        found = orient_by_patches(points, axes, dense.propagation.patches[kept], dense.propagation.parts[kept], local)
    source, confirmed = cloud.unsigned_source, None
    if cloud.normals is not None and cloud.oriented:
        kind, confirmed = compare_normals(cloud.normals[kept], found)
        source = SOURCES[kind]
    signs = Signs(source, confirmed, found.coverage if source in ("none", "axes", "contradictory") else None)
    given = signs.apply(cloud.normals)
    flips = np.where((found.normals * axes).sum(1) < 0, -1.0, 1.0)[samples.owner, None]
    normals = dense.propagation.normals * flips if given is None else given
    turned = time.perf_counter()
    begin("counting")
    made = (found.cut,) if given is None and found.cut is not None else ()
    votes, quality, cut = gather_dense_votes(dense, normals, samples, local, found.complex_, few.result(), made)
    spacing, finest = typical_and_finest(local.spacings)
    complex_ = found.complex_
    look = Look(
        signs, normals, votes, quality, cut, complex_, kept, points, spacing, finest, turned, preparation="sampled"
    )
    if tally(votes)[1] == 1 or (given is None and found.coverage < _SHOWS_A_SURFACE):
        return look
    more = None if given is None and found.cut is None else more_samples(dense, normals, are_found=given is None)
    if more is not None:
        return _closer(look, more, dense.points[more.kept])
    given_axes = None if cloud.normals is None else cloud.normals[kept]
    return _with_samples_shifted(look, local, found if given is None else None, given_axes)


def _closer(look: Look, more: MoreSamples, points: Floats) -> Look:
    """The same with the votes of more samples."""
    votes = more.with_votes_of_fewer(look.votes)
    spacing, finest = typical_and_finest(more.spacings)
    roughness = look.quality.roughness * look.spacing / spacing
    quality = replace(look.quality, coverage=more.cut.coverage, roughness=roughness)
    look = replace(look, votes=votes, quality=quality, cut=more.cut, complex_=more.complex_, kept=more.kept)
    return replace(look, points=points, spacing=spacing, finest=finest)


def _with_samples_shifted(look: Look, local: LocalGeometry, found: Orientation | None, axes: Floats | None) -> Look:
    """The same with the cuts of shifted samples; what half of them and the fields show stays.

    Where no shift is better, the normals stay as well: signs at full density are better than those of poles of samples.
    """
    best = widened_look(look, local, found, axes)
    doubts = best.others if found else ()
    if not best.is_shifted:
        return replace(look, votes=look.votes + doubts)
    cuts, cut = cut_votes(best.complex_, best.normals, best.cuts)
    stay = tuple(vote for vote in look.votes if vote.family != "cut")
    return replace(look, votes=(*cuts, *stay, *doubts), cut=cut, complex_=best.complex_, is_widened=True)
