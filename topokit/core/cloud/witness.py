"""The global witness of a point cloud: outward normals, the votes on its Euler characteristic, and what supports them.

It returns numbers; `topokit.report.verdict` decides how far they may be believed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.cloud.copies import distinct
from topokit.core.cloud.cubes import curve_order
from topokit.core.cloud.cut_counts import count_parts
from topokit.core.cloud.cut_surface import cut_surface
from topokit.core.cloud.dense import MOST_POINTS, thinned
from topokit.core.cloud.findings import Signs, SmoothedLook, Witness
from topokit.core.cloud.look import Cloud, Look
from topokit.core.cloud.looks import look_at
from topokit.core.cloud.neighborhoods import (
    FEWEST_POINTS,
    centered_positions,
    project_to_planes,
    unit,
)
from topokit.core.cloud.planes import turned_towards
from topokit.core.cloud.rounding import single_precision_step
from topokit.core.cloud.stage_seconds import stage_seconds
from topokit.core.cloud.uncovered import uncovered_patches
from topokit.core.cloud.votes import tally
from topokit.core.cloud.wires import WireReading
from topokit.core.neighbors.kd_tree import nearest_in_tree
from topokit.core.processors import one_thread
from topokit.core.progress import stages
from topokit.errors import InputError

__all__ = ["Signs", "SmoothedLook", "Witness", "global_witness"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_ROUGH = 0.5  # roughness from which a cloud may be looked at again, smoothed
_WIDE = 64  # neighbors of that smoothing
_CONTRADICTION = 0.5  # agreement below which the second look is taken
_UNANIMOUS = 0.9  # agreement of the smoothed cloud from which its integer is taken over
_QUERIES = 1 << 20  # points whose nearest neighbors are looked up at once
_SMALLEST_FEATURE = 2.5  # sample spacings that a feature must measure to be seen in clean samples
_BLUR = 2.0  # by how many spacings more for each spacing of roughness beyond that of clean samples
_CLEAN = 0.15  # roughness of clean samples of curved surfaces


@one_thread()
def global_witness(
    points: Tensor,
    normals: Tensor | None = None,
    areas: Tensor | None = None,
    *,
    oriented: bool = True,
    may_smooth: Callable[[], bool] | None = None,
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
        may_smooth: asked whether a cloud that is noisier than its spacing may be looked at again, smoothed; by default
            it may.

    Raises:
        InputError: for fewer than 32 points, points that are not finite, in a plane, on a line or coinciding, and for
            normals or areas that do not fit the points or are not finite.
    """
    start = time.perf_counter()
    positions, unit_length = centered_positions(_as_floats(points))
    given = None if normals is None else unit(_matching(normals, positions.shape, "normals"))
    scaled = None if areas is None else _matching(areas, positions.shape[:1], "areas") / unit_length**2
    chosen = thinned(positions)
    first, owner = _in_order(positions[chosen])
    if len(first) < FEWEST_POINTS:
        raise InputError(f"{len(first)} distinct points are too few to bound a solid: {FEWEST_POINTS} are needed.")
    kept = chosen[first]
    summed = None if scaled is None else _summed(scaled[chosen], owner, len(positions) / len(chosen))
    with stages(stage_seconds(len(kept))):
        look = look_at(Cloud(positions[kept], None if given is None else given[kept], summed, oriented))
    components, cavities = count_parts(look.complex_, look.cut.inside)
    euler, agreement = tally(look.votes)
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
        surface=None,
        preparation=look.preparation,
        is_widened=look.is_widened,
        is_repeated=look.is_repeated,
        rounding=single_precision_step(points),
    )
    if look.wire is not None:
        return _as_wire(witness, look.wire)
    surface = cut_surface(look.complex_, look.cut.inside, euler)
    patches = uncovered_patches(look.complex_, look.cut.inside, positions[kept])
    used = kept[look.kept]
    surface = replace(surface, points=used[surface.points])
    uncovered = tuple(replace(patch, samples=used[patch.samples]) for patch in patches)
    witness = replace(witness, surface=surface, uncovered=uncovered)
    return _second_look(witness, look.points, may_smooth)


def _in_order(points: Floats) -> tuple[Integers, Integers]:
    """As `distinct`, but many points in the order of a curve: neighbors in space are neighbors in memory."""
    first, owner = distinct(points)
    if len(first) <= MOST_POINTS:
        return first, owner
    order, _ = curve_order(points[first])
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[owner]


def _normals_of_all(positions: Floats, chosen: Integers, owner: Integers, given: Floats | None, look: Look) -> Floats:
    """Outward unit normals (N, 3) for all points, from those of the distinct ones among the chosen."""
    outward = look.signs.apply(given)
    if outward is not None:
        return outward
    normals = look.normals[owner]
    if len(chosen) < len(positions):
        normals = normals[_nearest(positions[chosen], positions)]
    return normals if given is None else turned_towards(given, normals)


def _nearest(targets: Floats, points: Floats) -> Integers:
    """Index of the nearest target (M, 3) of every point (N, 3)."""
    tree = cKDTree(targets, balanced_tree=False, compact_nodes=False)
    found = np.empty(len(points), dtype=np.int64)
    for rows in np.array_split(curve_order(points)[0], -(-len(points) // _QUERIES)):  # near each other: twice as fast
        found[rows] = nearest_in_tree(tree, points[rows], 1)
    return found


def _as_wire(witness: Witness, wire: WireReading) -> Witness:
    """The same evidence with the integer of a thickened graph."""
    return replace(witness, euler=wire.euler, components=wire.components, cavities=0, wire=wire)


def _second_look(witness: Witness, points: Floats, may_smooth: Callable[[], bool] | None) -> Witness:
    """Where noise exceeds the spacing and the votes contradict each other, look again at smoothed points.

    The points are projected onto the planes of wide neighborhoods. Their integer is taken over if nearly all votes then
    agree.
    """
    noisy = witness.quality.roughness >= _ROUGH and witness.agreement < _CONTRADICTION
    if not noisy or len(points) <= _WIDE or witness.preparation == "sampled":
        return witness
    if may_smooth is not None and not may_smooth():
        return witness
    with stages({}):  # nobody is told again of the same stages
        again = global_witness(torch.from_numpy(project_to_planes(points, _WIDE)), may_smooth=lambda: False)
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
