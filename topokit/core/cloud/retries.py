"""Where votes differ: all points there, samples shifted along their normals, or smoothed samples.

A large cloud has more points than samples. All of them are looked at where cuts label the same tetrahedra differently.

Where two sheets are closer than the sample spacing, tetrahedra join the wrong ones. A shift outward thickens the wall
between them, a shift inward widens the gap, and neither changes the topology as long as the way is free. Several shifts
compete. All samples lie on the surface, so that shift is the best whose cuts leave the fewest of them off it. That
holds for given normals. Found ones fit the solid that they were found with, so coverage is biased: every shift corrects
them first, and the majority among the shifts whose own cuts agree is taken.

Noisy samples are moved onto the planes of their neighbors, and everything is done again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from topokit.core.arrays import Booleans, Floats
from topokit.core.cloud.normals.patches import Neighborhoods, flattened, opposite_neighbors, patches_of
from topokit.core.cloud.orientation import Orientation
from topokit.core.cloud.reconstruction import Cloud, Reconstruction, reconstruct
from topokit.core.cloud.settings import CloudSettings
from topokit.core.cloud.solid.poles import normals_by_poles
from topokit.core.cloud.solid.tetrahedra import Cut, DelaunayComplex, cut_complex
from topokit.core.cloud.votes import (
    IN_COMPARISON,
    OrientedCloud,
    Vote,
    complex_of,
    cut_votes,
    gather_votes,
    share_of,
    surface_eulers,
    tally,
    values_of,
)
from topokit.core.progress import stages


def reconstruct_again(before: Reconstruction, settings: CloudSettings) -> Reconstruction:
    """The same if all votes agree, or if no surface shows or it has holes; else what more or moved samples add.

    Whether the answer about a surface with holes is likely does not depend on the votes.
    """
    euler, share = tally(before.votes)
    is_unanimous = share == 1
    is_rough = before.quality.roughness > settings.quality.clean
    is_noisy = is_rough and before.found is not None and before.found.coverage < settings.orientation.interpolating
    if is_noisy and before.cloud.samples.is_all:
        return before if is_unanimous and not before.lids else _with_less_noise(before, settings)
    is_hidden = not before.has_given_signs and before.quality.coverage < settings.orientation.hidden
    has_converged = share_of(euler, values_of(before.votes, "coarse cut")) == 1
    if before.has_holes or is_hidden or (is_unanimous and has_converged):
        return before
    closer = _with_all_points_in_doubt(before, settings)
    return closer or (before if is_unanimous else _with_shifts(before, settings))


def _with_all_points_in_doubt(before: Reconstruction, settings: CloudSettings) -> Reconstruction | None:
    """The same with all points of the cloud around the tetrahedra that cuts label differently.

    None if there are no more points or no such tetrahedra, or if the cuts of the new samples differ or no field has
    their integer. Signs from empty spheres must give the same one: where walls are too thin for any number of samples,
    cuts may agree on what the next signs refute.
    """
    cloud, most = before.cloud, 2 * settings.sampling.samples
    if cloud.samples.is_all or not (in_doubt := _in_doubt(before, settings)).any():
        return None
    kept, owner = cloud.samples.with_all_of(in_doubt, cloud.points, most)
    local, complex_ = complex_of(cloud.points[kept], settings)
    outward = cloud.normals[kept]
    votes, cuts = cut_votes("cut", complex_, outward, settings)
    fields = [vote for vote in before.votes if vote.family == "field"]
    refuted = fields and votes[0].eulers[0] not in values_of(fields, "field")
    if len(set(values_of(votes, "cut"))) > 1 or refuted:
        return None
    if not before.has_given_signs:
        _, corrected = normals_by_poles(complex_, outward, cuts[0], settings.cuts.first, rounds=1)
        if surface_eulers(complex_, corrected) != votes[0].eulers:
            return None
    fewer = [replace(vote, family="coarse cut") for vote in before.votes if vote.family == "cut"]
    samples = replace(cloud.samples, kept=kept, owner=owner)
    roughness = before.quality.roughness * cloud.local.spacing / local.spacing
    return replace(
        before,
        cloud=replace(cloud, samples=samples, local=local, complex_=complex_),
        votes=(*votes, *fewer, *fields),
        cuts=cuts,
        quality=replace(before.quality, coverage=cuts[0].coverage, roughness=roughness),
    )


def _in_doubt(before: Reconstruction, settings: CloudSettings) -> Booleans:
    """Which samples (M,) are at tetrahedra that one cut calls inside and another outside, or have a neighbor there."""
    complex_, local = before.cloud.complex_, before.cloud.local
    differs = np.any([cut.inside != before.cut.inside for cut in before.cuts], axis=0)
    at_it = np.zeros(len(local.points), dtype=bool)
    at_it[complex_.tetrahedra[differs]] = True
    found = at_it.copy()
    found[local.index[at_it, : settings.patches.graph + 1]] = True
    return found


def _with_less_noise(before: Reconstruction, settings: CloudSettings) -> Reconstruction:
    """The same with the votes of smoothed samples, whose normals are found anew; the quality stays that of the points.

    The votes of both count. The surface is that of the smoothed samples, if their votes alone give the integer.
    """
    moved = flattened(before.cloud.outward, before.cloud.local, settings.patches)
    with stages({}):  # suppress nested progress
        axes = before.cloud.samples.axes  # given ones, or None
        again = reconstruct(Cloud(moved, axes, oriented=False), patches_of(moved, settings.patches), settings)
    votes = before.votes + again.votes
    shown = again if tally(again.votes)[0] == tally(votes)[0] else before
    return replace(before, cloud=shown.cloud, votes=votes, cuts=shown.cuts, is_smoothed=True)


@dataclass(frozen=True, eq=False)
class _Shift:
    """Samples at some positions: the shift (M,) in units of length, normals (M, 3), cuts there and what these count."""

    length: Floats
    normals: Floats
    local: Neighborhoods
    complex_: DelaunayComplex
    cuts: tuple[Cut, ...]
    votes: tuple[Vote, ...]

    @property
    def missed(self) -> float:
        """The share of the samples that the cuts leave off the surface."""
        return sum(1 - cut.coverage for cut in self.cuts)


def _with_shifts(before: Reconstruction, settings: CloudSettings) -> Reconstruction:
    """The same at the positions of the samples, shifted or not, that show the surface best."""
    cloud, found = before.cloud, before.found
    axes, trials = _shifted(cloud, before.cut, found, settings)
    candidates = trials if found is None else _of_most_cuts(trials)
    best = min(candidates, key=lambda trial: trial.missed)
    others = tuple(vote for trial in trials if trial is not best for vote in trial.votes) if found else ()
    if best is trials[0] and not cloud.samples.is_all:
        return replace(before, votes=before.votes + others)  # signs at full density are better than those of poles
    if best is trials[0] and found is None:
        return before
    normals = cloud.samples.spread(best.normals, cloud.normals)
    points = cloud.points + best.length[cloud.samples.owner, None] * cloud.samples.spread(axes, cloud.normals)
    moved = replace(cloud, points=points, normals=normals, local=best.local, complex_=best.complex_)
    votes, cuts = gather_votes(moved, settings, best.cuts)
    return replace(before, cloud=moved, votes=votes + others, cuts=cuts, is_shifted=best is not trials[0])


def _shifted(
    cloud: OrientedCloud, cut: Cut, found: Orientation | None, settings: CloudSettings
) -> tuple[Floats, list[_Shift]]:
    """The normals (M, 3) along which samples are shifted, and the samples as they are and at every shift.

    Signs that were found are corrected by poles, first and at each shift.
    """
    normals, axes = cloud.outward, cloud.samples.axes
    if found is not None:
        corrected = found.corrected(cloud.complex_, axes, settings)
        normals, cut = corrected.normals, corrected.cut
    trials = [_trial(np.zeros(len(normals)), normals, cloud.local, cloud.complex_, cut, settings)]

    def moved(shift: Floats) -> tuple[Floats, Neighborhoods, DelaunayComplex]:
        length = shift * cloud.local.spacings
        return length, *complex_of(cloud.local.points + length[:, None] * normals, settings)

    shifts = list(_lengths(normals, cloud.local, settings))
    with ThreadPoolExecutor(1) as thread:  # flows hold the interpreter's lock, tetrahedra do not
        for length, local, complex_ in thread.map(moved, shifts):
            turned, its_cut = normals, cut_complex(complex_, normals, settings.cuts.first)
            if found is not None:
                turned, its_cut = normals_by_poles(complex_, normals, its_cut, settings.cuts.first, rounds=1, axes=axes)
            trials.append(_trial(length, turned, local, complex_, its_cut, settings))
    return normals, trials


def _trial(
    length: Floats,
    normals: Floats,
    local: Neighborhoods,
    complex_: DelaunayComplex,
    first: Cut,
    settings: CloudSettings,
) -> _Shift:
    votes, cuts = cut_votes("shifted cut", complex_, normals, settings, made=(first,), count=IN_COMPARISON)
    return _Shift(length, normals, local, complex_, cuts, tuple(votes))


def _of_most_cuts(trials: Sequence[_Shift]) -> list[_Shift]:
    """Of those whose own cuts agree, those with the integer that most cuts of all give; the first if there is none."""
    values = [values_of(trial.votes, "shifted cut") for trial in trials]
    counts = Counter(chain(*values))
    steady = [(trial, own[0]) for trial, own in zip(trials, values, strict=True) if len(set(own)) == 1]
    most = max((counts[euler] for _, euler in steady), default=0)
    return [trial for trial, euler in steady if counts[euler] == most] or [trials[0]]


def _lengths(normals: Floats, local: Neighborhoods, settings: CloudSettings) -> Iterator[Floats]:
    """Shifts outward (M,) in spacings: of all samples alike, and of each to the side that has more room."""
    own = settings.shifts
    behind, ahead = clearances(normals, local, settings)
    toward_room = np.clip(ahead - behind, -1, 1)
    around = local.index[:, : settings.patches.graph + 1]
    for _ in range(2):
        toward_room = toward_room[around].mean(1)
    outward = 1.0 if behind.sum() <= ahead.sum() else -1.0  # away from what is thinner, walls or gaps
    for length in own.lengths:
        yield np.full(len(normals), outward * length)
        yield length * toward_room


def clearances(normals: Floats, local: Neighborhoods, settings: CloudSettings) -> tuple[Floats, Floats]:
    """Thickness of the wall behind each sample and width of the gap in front of it, (M,), in spacings, at most 3.

    Args:
        normals: (M, 3), unit, outward.
        local: neighborhoods of the samples, among which the opposite sheet is looked for.
        settings: of the distances.
    """
    own = settings.shifts
    points, index = local.points, local.index[:, 1:]
    opposite, height, side = opposite_neighbors(points, normals, points[index], normals[index], settings.patches)
    back = ((points[:, None] - points[index]) * normals[index]).sum(2)  # the height, seen from the other sample
    spacing = local.spacings[:, None]
    aside = np.maximum(np.sqrt(np.maximum(side, 0)) - own.sideways * spacing, 0)
    distance = np.hypot(height, aside) / spacing
    walls, gaps = opposite & (height < 0) & (back < 0), opposite & (height > 0) & (back > 0)
    behind, ahead = (np.where(facing, distance, own.free).min(1) for facing in (walls, gaps))
    return np.minimum(behind, own.free), np.minimum(ahead, own.free)
