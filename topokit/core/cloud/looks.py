"""One look at a cloud: at all of its points, at samples where features are small, at averages, or as at a wire."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.cloud.axes import SurfaceAxes, surface_axes
from topokit.core.cloud.delaunay_cut import Cut, DelaunayComplex, delaunay_complex
from topokit.core.cloud.dense import MOST_POINTS, SAMPLES, DenseCloud, averaged, dense_cloud, is_noisy
from topokit.core.cloud.downsampling import downsample
from topokit.core.cloud.findings import Preparation, Signs, SignSource
from topokit.core.cloud.more_samples import MoreSamples, more_samples
from topokit.core.cloud.neighborhoods import (
    LocalGeometry,
    compatible_areas,
    flatten,
    local_geometry,
    turned_towards,
    typical_and_finest,
)
from topokit.core.cloud.orientation import (
    INTERPOLATING,
    Orientation,
    check_normals,
    compare_normals,
    orient_by_patches,
    orient_samples,
)
from topokit.core.cloud.solidity import fills_space
from topokit.core.cloud.votes import (
    SampleQuality,
    Vote,
    cut_votes,
    fewer_samples,
    gather_dense_votes,
    gather_votes,
    tally,
)
from topokit.core.cloud.widening import Widening, widened
from topokit.core.cloud.wires import WireReading, looks_narrow, read_wire
from topokit.core.kd_tree import nearest_in_tree
from topokit.core.stages import begin
from topokit.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_SOURCES: dict[str, SignSource] = {"outward": "given", "inward": "reversed", "mixed": "contradictory"}
_SHOWS_A_SURFACE = 0.5  # coverage of a large cloud's samples below which no other samples of it show a surface
_WIRE_SAMPLES = 10_000  # evenly spread points of a large cloud that is read as a wire


@dataclass(frozen=True, eq=False)
class Cloud:
    """Distinct points ready to be looked at: centered and scaled.

    Attributes:
        points: (N, 3), in units of a power of two near the length of the cloud.
        normals: (N, 3), unit, or None.
        areas: (N,), area per point, or None.
        oriented: whether the signs of the normals mean anything.
    """

    points: Floats
    normals: Floats | None
    areas: Floats | None
    oriented: bool

    @property
    def unsigned_source(self) -> SignSource:
        """Where outward directions come from if no given signs are used."""
        return "none" if self.normals is None else "axes"

    def reduced(self, kept: Integers, moved: Floats) -> Cloud:
        """Some of its points at other positions, without areas."""
        return Cloud(moved, None if self.normals is None else self.normals[kept], None, self.oriented)


@dataclass(frozen=True, eq=False)
class Look:
    """What one look at a cloud found.

    Attributes:
        signs: where the outward directions came from.
        normals: (N, 3), unit, outward, of all points of the cloud.
        votes: with the quality of the samples and the first cut.
        quality: see there.
        cut: see there.
        complex_: tetrahedra of the samples.
        kept: (M,), indices of the samples in the cloud.
        points: (M, 3), where the samples are taken to be.
        spacing: typical distance between samples.
        finest: that of the finest samples.
        turned: when the normals were found.
        wire: the reading as a thickened graph, or None.
        preparation: see `Witness`.
        is_widened: see `Witness`.
        is_repeated: see `Witness`.
    """

    signs: Signs
    normals: Floats
    votes: tuple[Vote, ...]
    quality: SampleQuality
    cut: Cut
    complex_: DelaunayComplex
    kept: Integers
    points: Floats
    spacing: float
    finest: float
    turned: float
    wire: WireReading | None = None
    preparation: Preparation = "whole"
    is_widened: bool = False
    is_repeated: bool = False


def look_at(cloud: Cloud) -> Look:
    """Look at a cloud in the way that its size, noise and shape ask for.

    Raises:
        InputError: if its points fill space, or all lie in a plane.
    """
    begin("neighborhoods")
    if len(cloud.points) <= MOST_POINTS:
        _refuse_space(cloud.points)
        return _look_at_all(cloud, read_wire(cloud.points))
    surface = surface_axes(cloud.points)
    strand = _strand(cloud.points, surface.tree)
    if strand is not None:
        return _look_at_part(cloud, *strand, "wire")
    if not is_noisy(surface):
        return _look_at_samples(_dense(cloud, surface), cloud)
    _refuse_space(cloud.points)
    kept, moved, is_thinned = averaged(cloud.points, surface.tree)
    strand = _strand(moved, cKDTree(moved))
    if strand is not None:
        part, moved, wire = strand
        return _look_at_part(cloud, kept[part], moved, wire, "averaged")
    return _look_at_part(cloud, kept, moved, None, "thinned" if is_thinned else "averaged")


def _strand(points: Floats, tree: cKDTree) -> tuple[Integers, Floats, WireReading] | None:
    """Evenly spread points of a cloud, their positions, and the reading of the cloud as a wire, if it is one."""
    if not looks_narrow(points, tree):
        return None
    kept, _ = downsample(points, _WIRE_SAMPLES, "even")
    wire = read_wire(points[kept])
    return None if wire is None else (kept, points[kept], wire)


def _refuse_space(points: Floats) -> None:
    if fills_space(points):
        raise InputError(
            f"the {len(points)} points fill space: neighborhoods of all sizes are as thick as they are wide, so they "
            "lie on no surface."
        )


def _look_at_part(
    cloud: Cloud, kept: Integers, moved: Floats, wire: WireReading | None, preparation: Preparation
) -> Look:
    """A look at some points, perhaps moved, as one at the cloud; every point has the normal of the nearest of them."""
    look = _look_at_all(cloud.reduced(kept, moved), wire)
    nearest = nearest_in_tree(cKDTree(look.points), cloud.points, 1)
    return replace(look, kept=kept[look.kept], normals=look.normals[nearest], preparation=preparation)


def _dense(cloud: Cloud, surface: SurfaceAxes) -> DenseCloud:
    axes = surface.axes if cloud.normals is None else cloud.normals
    areas = surface.areas if cloud.areas is None else cloud.areas
    begin("signs")
    return dense_cloud(cloud.points, replace(surface, axes=axes, areas=areas))


def _look_at_all(cloud: Cloud, wire: WireReading | None) -> Look:
    """A look at all points; where the votes differ, also at shifted or, with noise, at smoothed ones."""
    look, local, found = _look_once(cloud, wire)
    if wire is not None or tally(look.votes)[1] == 1:
        return look
    if found is None or found.coverage >= INTERPOLATING:
        return _with_more_room(look, local, found, cloud.normals)
    return _with_less_noise(look, local, cloud.normals)


def _look_once(cloud: Cloud, wire: WireReading | None) -> tuple[Look, LocalGeometry, Orientation | None]:
    local = local_geometry(cloud.points, cloud.areas)
    begin("orientation")
    signs, outward, complex_, found = _outward(cloud, local, wire)
    turned = time.perf_counter()
    begin("counting")
    weights = compatible_areas(outward, local) if cloud.areas is None else local.areas
    votes, quality, cut = gather_votes(cloud.points, outward, local, weights, complex_)
    spacing = float(np.sqrt(weights.mean()))
    every = np.arange(len(cloud.points))
    look = Look(signs, outward, votes, quality, cut, complex_, every, cloud.points, spacing, spacing, turned, wire)
    return look, local, found


def _with_less_noise(look: Look, local: LocalGeometry, axes: Floats | None) -> Look:
    """The same with the votes of smoothed samples, whose normals are found anew; the quality stays that of the points.

    The votes of both count. The surface is that of the samples whose votes alone give the integer.
    """
    again, _, _ = _look_once(Cloud(flatten(look.points, look.normals, local), axes, None, oriented=False), None)
    votes = look.votes + again.votes
    shown = look if tally(look.votes)[0] == tally(votes)[0] else again
    return replace(look, votes=votes, cut=shown.cut, complex_=shown.complex_, normals=shown.normals, is_repeated=True)


def _with_more_room(look: Look, local: LocalGeometry, found: Orientation | None, axes: Floats | None) -> Look:
    """The same, or with the votes of shifted samples; the quality stays that of the points."""
    best = _widened(look, local, found, axes)
    if not (best.is_shifted or found):
        return look
    areas = compatible_areas(best.normals, best.local)
    votes, _, cut = gather_votes(best.points, best.normals, best.local, areas, best.complex_, best.cuts)
    votes += best.others if found else ()
    return replace(look, votes=votes, cut=cut, complex_=best.complex_, is_widened=best.is_shifted)


def _look_at_samples(dense: DenseCloud, cloud: Cloud) -> Look:
    begin("samples")
    samples = dense.samples(SAMPLES)
    kept = samples.kept
    points, axes = dense.points[kept], dense.propagation.normals[kept]
    with ThreadPoolExecutor(1) as thread:
        few = thread.submit(fewer_samples, dense, len(kept) // 2)  # needs no signs, and Qhull no interpreter
        local = local_geometry(points, samples.areas, axes)
        begin("orientation")
        found = orient_by_patches(points, axes, dense.propagation.patches[kept], dense.propagation.parts[kept], local)
    source, confirmed = cloud.unsigned_source, None
    if cloud.normals is not None and cloud.oriented:
        kind, confirmed = compare_normals(cloud.normals[kept], found)
        source = _SOURCES[kind]
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
    votes, quality = more.with_votes_of_fewer(look.votes), replace(look.quality, coverage=more.cut.coverage)
    spacing, finest = typical_and_finest(more.spacings)
    look = replace(look, votes=votes, quality=quality, cut=more.cut, complex_=more.complex_, kept=more.kept)
    return replace(look, points=points, spacing=spacing, finest=finest)


def _with_samples_shifted(look: Look, local: LocalGeometry, found: Orientation | None, axes: Floats | None) -> Look:
    """The same with the cuts of shifted samples; what half of them and the fields show stays.

    Where no shift is better, the normals stay as well: signs at full density are better than those of poles of samples.
    """
    best = _widened(look, local, found, axes)
    doubts = best.others if found else ()
    if not best.is_shifted:
        return replace(look, votes=look.votes + doubts)
    cuts, cut = cut_votes(best.complex_, best.normals, best.cuts)
    stay = tuple(vote for vote in look.votes if vote.family != "cut")
    return replace(look, votes=(*cuts, *stay, *doubts), cut=cut, complex_=best.complex_, is_widened=True)


def _widened(look: Look, local: LocalGeometry, found: Orientation | None, axes: Floats | None) -> Widening:
    """The positions that show the surface best, from given normals or from those of an orientation."""
    if found is None:
        return widened(look.points, look.normals[look.kept], local, look.complex_, look.cut, are_found=False)
    normals, cut = found.corrected(axes)
    return widened(look.points, normals, local, look.complex_, cut, are_found=True, axes=axes)


def _outward(
    cloud: Cloud, local: LocalGeometry, wire: WireReading | None
) -> tuple[Signs, Floats, DelaunayComplex, Orientation | None]:
    """Outward normals (N, 3), where their signs came from, and the tetrahedra and the orientation found on the way."""
    given, source, confirmed = cloud.normals, cloud.unsigned_source, None
    if given is not None and cloud.oriented:
        complex_ = delaunay_complex(cloud.points, local.spacings)
        kind, confirmed = check_normals(cloud.points, given, compatible_areas(given, local), local, complex_)
        source = _SOURCES[kind]
        signs = Signs(source, confirmed, None)
        outward = signs.apply(given)
        if outward is not None:
            return signs, outward, complex_, None
    if wire is not None:
        outward = wire.normals if given is None else turned_towards(given, wire.normals)
        return Signs(source, confirmed, None), outward, delaunay_complex(cloud.points, local.spacings), None
    found = orient_samples(cloud.points, local)
    outward = found.normals if given is None else turned_towards(given, found.normals)
    return Signs(source, confirmed, found.coverage), outward, found.complex_, found
