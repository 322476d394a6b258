"""The global witness of a point cloud: outward normals, the votes on its Euler characteristic, and what supports them.

It returns numbers; `topokit.report.verdict` decides how far they may be believed.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.cloud.axes import surface_axes
from topokit.core.cloud.cut_surface import cut_surface
from topokit.core.cloud.delaunay_cut import Cut, DelaunayComplex, count_parts, delaunay_complex
from topokit.core.cloud.dense import (
    MOST_POINTS,
    SAMPLES,
    DenseCloud,
    averaged,
    dense_cloud,
    is_noisy,
    thinned,
)
from topokit.core.cloud.downsampling import distinct
from topokit.core.cloud.findings import Preparation, Signs, SignSource, SmoothedLook, Witness
from topokit.core.cloud.neighborhoods import (
    FEWEST_POINTS,
    LocalGeometry,
    centered_positions,
    compatible_areas,
    local_geometry,
    project_to_planes,
    turned_towards,
    unit,
)
from topokit.core.cloud.orientation import check_normals, compare_normals, orient_by_patches, orient_samples
from topokit.core.cloud.votes import SampleQuality, Vote, gather_dense_votes, gather_votes, tally
from topokit.core.cloud.wires import WireReading, read_wire
from topokit.core.kd_tree import nearest_in_tree
from topokit.core.threads import one_thread
from topokit.errors import InputError

__all__ = ["Signs", "SmoothedLook", "Witness", "global_witness"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_ROUGH = 0.5  # roughness from which a cloud may be looked at again, smoothed
_WIDE = 64  # neighbors of that smoothing
_CONTRADICTION = 0.5  # agreement below which the second look is taken
_UNANIMOUS = 0.9  # agreement of the smoothed cloud from which its integer is taken over
_SMALLEST_FEATURE = 2.5  # sample spacings that a feature must measure to be seen in clean samples
_BLUR = 2.0  # by how many spacings more for each spacing of roughness beyond that of clean samples
_CLEAN = 0.15  # roughness of clean samples of curved surfaces
_SOURCES: dict[str, SignSource] = {"outward": "given", "inward": "reversed", "mixed": "contradictory"}
_FINEST = 0.1  # share of the samples of a large cloud whose spacing may be finer than the stated one


@dataclass(frozen=True, eq=False)
class _Cloud:
    """Distinct points ready to be looked at: centered and scaled.

    Attributes:
        points: (N, 3), in units of `unit_length`.
        normals: (N, 3), unit, or None.
        areas: (N,), area per point, or None.
        oriented: whether the signs of the normals mean anything.
    """

    points: Floats
    normals: Floats | None
    areas: Floats | None
    oriented: bool


@dataclass(frozen=True, eq=False)
class _Look:
    """What one look at a cloud found.

    Attributes:
        signs: where the outward directions came from.
        normals: (N, 3), unit, outward, of all points of the cloud.
        votes: with the quality of the samples and the first cut.
        quality: see there.
        cut: see there.
        complex_: tetrahedra of the samples.
        kept: (M,), indices of the samples in the cloud.
        spacing: typical distance between samples.
        finest: that of the finest samples.
        turned: when the normals were found.
        wire: the reading as a thickened graph, or None; large clouds are not read in this way.
    """

    signs: Signs
    normals: Floats
    votes: tuple[Vote, ...]
    quality: SampleQuality
    cut: Cut
    complex_: DelaunayComplex
    kept: Integers
    spacing: float
    finest: float
    turned: float
    wire: WireReading | None = None


@one_thread()
def global_witness(
    points: Tensor,
    normals: Tensor | None = None,
    areas: Tensor | None = None,
    *,
    oriented: bool = True,
    may_smooth: bool = True,
) -> Witness:
    """The global evidence about a cloud's closed surface.

    Of more than 30 000 points the normals and signs are found at full density (of more than two million, at two
    million); then 20 000 samples are taken where features are small. Runs on the CPU, is deterministic, and is not
    differentiable.

    Args:
        points: (N, 3) samples of a surface, any float dtype and device.
        normals: (N, 3), any positive length, outward; found if None, reversed if they all point inward, and found anew
            if they contradict each other.
        areas: (N,), surface area that each sample stands for; estimated from the neighbors if None.
        oriented: whether the signs of the normals mean anything; if not, the normals are axes and their signs are
            found.
        may_smooth: whether a cloud that is noisier than its spacing may be looked at again, smoothed.

    Raises:
        InputError: for fewer than 32 points, points that are not finite, in a plane, on a line or coinciding, and for
            normals or areas that do not fit the points or are not finite.
    """
    start = time.perf_counter()
    positions, unit_length = centered_positions(_as_floats(points))
    given = None if normals is None else unit(_matching(normals, positions.shape, "normals"))
    scaled = None if areas is None else _matching(areas, positions.shape[:1], "areas") / unit_length**2
    chosen = thinned(positions)
    first, owner = distinct(positions[chosen])
    if len(first) < FEWEST_POINTS:
        raise InputError(f"{len(first)} distinct points are too few to bound a solid: {FEWEST_POINTS} are needed.")
    kept = chosen[first]
    summed = None if scaled is None else _summed(scaled[chosen], owner, len(positions) / len(chosen))
    cloud = _Cloud(positions[kept], None if given is None else given[kept], summed, oriented)
    look, preparation, used_points = _look(cloud)
    components, cavities = count_parts(look.complex_, look.cut.inside)
    euler, agreement = tally(look.votes)
    surface = cut_surface(look.complex_, look.cut.inside, euler)
    quality = look.quality
    witness = Witness(
        euler=euler,
        agreement=agreement,
        votes=look.votes,
        quality=quality,
        signs=look.signs,
        smoothed=None,
        components=components,
        cavities=cavities,
        normals=_normals_of_all(positions, chosen, owner, given, look),
        n_points=len(positions),
        n_used=len(look.kept),
        spacing=look.spacing * unit_length,
        resolution=look.finest * unit_length * (_SMALLEST_FEATURE + _BLUR * max(quality.roughness - _CLEAN, 0.0)),
        seconds={
            "orientation": look.turned - start,
            "votes": time.perf_counter() - look.turned,
        },
        surface=replace(surface, points=kept[look.kept][surface.points]),
        preparation=preparation,
    )
    if look.wire is not None:
        return _as_wire(witness, look.wire)
    return _second_look(witness, used_points) if may_smooth else witness


def _look(cloud: _Cloud) -> tuple[_Look, Preparation, Floats]:
    """A look at all points, at samples where features are small, or at averages; and the points that were used."""
    if len(cloud.points) <= MOST_POINTS:
        return _look_at_all(cloud), "whole", cloud.points
    surface = surface_axes(cloud.points)
    if not is_noisy(surface):
        axes = surface.axes if cloud.normals is None else cloud.normals
        areas = surface.areas if cloud.areas is None else cloud.areas
        look = _look_at_samples(dense_cloud(cloud.points, replace(surface, axes=axes, areas=areas)), cloud)
        return look, "sampled", cloud.points[look.kept]
    kept, moved = averaged(cloud.points, surface.tree)
    part = _Cloud(moved, None if cloud.normals is None else cloud.normals[kept], None, cloud.oriented)
    look = _look_at_all(part)
    nearest = nearest_in_tree(cKDTree(moved), cloud.points, 1)
    return replace(look, kept=kept[look.kept], normals=look.normals[nearest]), "averaged", moved


def _look_at_all(cloud: _Cloud) -> _Look:
    local = local_geometry(cloud.points, cloud.areas)
    wire = read_wire(cloud.points)
    signs, outward, complex_ = _outward(cloud, local, wire)
    turned = time.perf_counter()
    weights = compatible_areas(outward, local) if cloud.areas is None else local.areas
    votes, quality, cut = gather_votes(cloud.points, outward, local, weights, complex_)
    spacing = float(np.sqrt(weights.mean()))
    every = np.arange(len(cloud.points))
    return _Look(signs, outward, votes, quality, cut, complex_, every, spacing, spacing, turned, wire)


def _look_at_samples(dense: DenseCloud, cloud: _Cloud) -> _Look:
    samples = dense.samples(SAMPLES)
    points, axes = dense.points[samples.kept], dense.propagation.normals[samples.kept]
    local = local_geometry(points, samples.areas, axes)
    found = orient_by_patches(points, axes, dense.propagation.patches[samples.kept], local)
    source: SignSource = "none" if cloud.normals is None else "axes"
    confirmed = None
    normals = dense.propagation.normals * np.where((found.normals * axes).sum(1) < 0, -1.0, 1.0)[samples.owner, None]
    if cloud.normals is not None and cloud.oriented:
        kind, confirmed = compare_normals(cloud.normals[samples.kept], found)
        source = _SOURCES[kind]
    signs = Signs(source, confirmed, found.coverage if source in ("none", "axes", "contradictory") else None)
    if cloud.normals is not None and source in ("given", "reversed"):
        normals = cloud.normals if source == "given" else -cloud.normals
    turned = time.perf_counter()
    votes, quality, cut = gather_dense_votes(dense, normals, samples, local, found.complex_)
    spacing, finest = np.quantile(local.spacings, (0.5, _FINEST))
    return _Look(
        signs, normals, votes, quality, cut, found.complex_, samples.kept, float(spacing), float(finest), turned
    )


def _outward(cloud: _Cloud, local: LocalGeometry, wire: WireReading | None) -> tuple[Signs, Floats, DelaunayComplex]:
    """Outward normals (N, 3) of all points, where their signs came from, and the tetrahedra built on the way."""
    given = cloud.normals
    source: SignSource = "none" if given is None else "axes"
    confirmed = None
    if given is not None and cloud.oriented:
        complex_ = delaunay_complex(cloud.points, local.spacings)
        kind, confirmed = check_normals(cloud.points, given, compatible_areas(given, local), local, complex_)
        if kind != "mixed":
            source, sign = ("given", 1.0) if kind == "outward" else ("reversed", -1.0)
            return Signs(source, confirmed, None), sign * given, complex_
        source = "contradictory"
    if wire is not None:
        outward = wire.normals if given is None else turned_towards(given, wire.normals)
        return Signs(source, confirmed, None), outward, delaunay_complex(cloud.points, local.spacings)
    found = orient_samples(cloud.points, local)
    outward = found.normals if given is None else turned_towards(given, found.normals)
    return Signs(source, confirmed, found.coverage), outward, found.complex_


def _normals_of_all(positions: Floats, chosen: Integers, owner: Integers, given: Floats | None, look: _Look) -> Floats:
    """Outward unit normals (N, 3) for all points, from those of the distinct ones among the chosen."""
    if given is not None and look.signs.source in ("given", "reversed"):
        return given if look.signs.source == "given" else -given
    normals = look.normals[owner]
    if len(chosen) < len(positions):
        normals = normals[nearest_in_tree(cKDTree(positions[chosen]), positions, 1)]
    return normals if given is None else turned_towards(given, normals)


def _as_wire(witness: Witness, wire: WireReading) -> Witness:
    """The same evidence with the integer of a thickened graph."""
    return replace(witness, euler=wire.euler, components=wire.components, cavities=0, surface=None, wire=wire)


def _second_look(witness: Witness, points: Floats) -> Witness:
    """Where noise exceeds the spacing and the votes contradict each other, look again at smoothed points.

    The points are projected onto the planes of wide neighborhoods. Their integer is taken over if nearly all votes then
    agree.
    """
    noisy = witness.quality.roughness >= _ROUGH and witness.agreement < _CONTRADICTION
    if not noisy or len(points) <= _WIDE or witness.preparation == "sampled":
        return witness
    again = global_witness(torch.from_numpy(project_to_planes(points, _WIDE)), may_smooth=False)
    if again.agreement < _UNANIMOUS or again.wire is not None:
        return witness
    return replace(
        witness,
        euler=again.euler,
        smoothed=SmoothedLook(again.euler, again.agreement, _WIDE),
        components=again.components,
        cavities=again.cavities,
        resolution=witness.resolution * _WIDE**0.5,
        surface=None,
    )


def _summed(areas: Floats, owner: Integers, factor: float) -> Floats:
    return np.asarray(np.bincount(owner, areas) * factor, dtype=np.float64)


def _as_floats(values: Tensor) -> Floats:
    return np.ascontiguousarray(values.detach().cpu().double().numpy())


def _matching(values: Tensor, shape: tuple[int, ...], name: str) -> Floats:
    found = _as_floats(values)
    if found.shape != shape:
        raise InputError(f"the {name} have shape {found.shape}, but the points need {shape}.")
    if not np.isfinite(found).all():
        raise InputError(f"some {name} are not finite.")
    return found
