"""The global witness of a point cloud: outward normals, the votes on its Euler characteristic, and what supports them.

It returns numbers; `topokit.report.verdict` decides how far they may be believed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.evidence import Preparation, Witness
from topokit.core.cloud.given_normals import Signs, consistent_signs
from topokit.core.cloud.guards import (
    FEWEST_POINTS,
    centered_positions,
    refuse_filled_space,
    single_precision_step,
)
from topokit.core.cloud.noise import averaged
from topokit.core.cloud.normals.patches import Patches, patches_of, turned_towards, unit
from topokit.core.cloud.reconstruction import Cloud, Reconstruction, reconstruct
from topokit.core.cloud.retries import reconstruct_again
from topokit.core.cloud.sampling.copies import distinct
from topokit.core.cloud.sampling.cube_hierarchy import curve_order
from topokit.core.cloud.sampling.downsampling import thin_along_curve
from topokit.core.cloud.scan_groups import separate_samples
from topokit.core.cloud.settings import CloudSettings
from topokit.core.cloud.solid.counts import count_parts
from topokit.core.cloud.solid.surface import cut_surface
from topokit.core.cloud.solid.wires import WireReading, read_wire
from topokit.core.cloud.votes import SampleQuality, crowded_share, tally
from topokit.core.labels import inverse_order
from topokit.core.neighbors.kd_tree import nearest_in_tree
from topokit.core.processors import one_thread
from topokit.core.progress import begin, stages
from topokit.errors import InputError

__all__ = ["CloudSettings", "Signs", "Witness", "global_witness"]


_QUERIES = 1 << 20  # points whose nearest neighbors are looked up at once


@one_thread()
def global_witness(
    points: Tensor, normals: Tensor | None = None, *, oriented: bool = True, settings: CloudSettings | None = None
) -> Witness:
    """The global evidence about a cloud's closed surface.

    Where the noise is larger than about half the spacing, fewer, evenly spread points are moved onto the planes of
    their neighborhoods and stand for all. Normals and their signs are found at full density (of more than two million
    points, at two million). Of more than 30 000 points, 20 000 samples are then taken where features are small. Minimum
    cuts of Delaunay tetrahedra of the samples and winding-number fields vote; where votes differ, all points
    there, shifted or smoothed samples are examined. Runs on the CPU, is deterministic, and is not differentiable.

    Args:
        points: (N, 3) samples of a surface, any float dtype and device.
        normals: (N, 3), any positive length, outward; found if None, reversed if they all point inward, and found anew
            if they contradict each other.
        oriented: whether the signs of the normals mean anything; if not, the normals are axes and their signs are
            found.
        settings: every number of the method; the measured ones by default.

    Raises:
        InputError: for fewer than 32 points, points that are not finite, in a plane, on a line or coinciding, points
            that fill space, and for normals that do not fit the points or are not finite.
    """
    settings, start = settings or CloudSettings(), time.perf_counter()
    entry = _Entry.of(points, normals, oriented, settings)
    with stages(_stage_weights(len(entry.kept), settings)):
        begin("neighborhoods")
        patches = patches_of(entry.cloud.points, settings.patches)
        strand = read_wire(patches.points, patches.tree, settings.wires)
        if strand is not None:
            return _wire_witness(entry, patches, *strand, settings, start)
        while (groups := separate_samples(patches, entry.cloud.signed, settings.sampling)) is not None:
            entry = entry.represented(*groups)
            patches = patches_of(entry.cloud.points, settings.patches)
        cloud = entry.cloud
        refuse_filled_space(cloud.points, settings.sampling.probes, settings.guards)
        preparation: Preparation = "whole" if len(cloud.points) <= settings.sampling.whole else "sampled"
        fewer = averaged(patches, settings)
        owner, blur = np.arange(len(cloud.points)), 0.0
        if fewer is not None:
            moved, kept, owner, blur = fewer
            cloud, preparation = cloud.at(moved, kept), "averaged"
            patches, entry = patches_of(moved, settings.patches), entry.reduced(kept)
        found = reconstruct_again(reconstruct(cloud, patches, settings, blur), settings)
        return _solid_witness(entry, found, owner, preparation, settings, start)


@dataclass(frozen=True, eq=False)
class _Entry:
    """Where the points of a cloud came from.

    Attributes:
        positions: (N, 3), all points given, centered and scaled.
        given: (N, 3), their unit normals, or None.
        cloud: the distinct ones among those that are measured, in the order of a curve.
        chosen: (C,), indices of the points that are measured.
        kept: (M,), indices of the cloud's points.
        owner: (C,), the point of the cloud at the place of each.
        unit_length: of the positions.
        rounding: step between neighboring coordinates, in units of length.
    """

    positions: Floats
    given: Floats | None
    cloud: Cloud
    chosen: Integers
    kept: Integers
    owner: Integers
    unit_length: float
    rounding: float

    @classmethod
    def of(cls, points: Tensor, normals: Tensor | None, oriented: bool, settings: CloudSettings) -> _Entry:
        positions, unit_length = centered_positions(_as_floats(points))
        given = None if normals is None else unit(_matching(normals, positions.shape, "normals"))
        chosen = thin_along_curve(positions, settings.sampling.most_points)
        first, group = distinct(positions[chosen])
        if len(first) < FEWEST_POINTS:
            raise InputError(f"{len(first)} distinct points are too few to bound a solid: {FEWEST_POINTS} are needed.")
        order = curve_order(positions[chosen[first]])[0]  # neighbors in space are neighbors in memory
        kept = chosen[first[order]]
        cloud = Cloud(positions[kept], None if given is None else given[kept], oriented)
        return cls(
            positions,
            given,
            cloud,
            chosen,
            kept,
            inverse_order(order)[group],
            unit_length,
            single_precision_step(points),
        )

    def reduced(self, kept: Integers) -> _Entry:
        """The same for some of the cloud's points."""
        return replace(self, kept=self.kept[kept])

    def represented(self, kept: Integers, owner: Integers) -> _Entry:
        """The same for some of the cloud's points, which stand for all: `owner` (M,) for each."""
        cloud = self.cloud.at(self.cloud.points[kept], kept)
        return replace(self, cloud=cloud, kept=self.kept[kept], owner=owner[self.owner])

    def normals(self, signs: Signs, outward: Floats) -> Floats:
        """Outward unit normals (N, 3) for all points given, from those of the cloud."""
        known = signs.apply(self.given)
        if known is not None:
            return known
        normals = outward[self.owner]
        if len(self.chosen) < len(self.positions):
            normals = normals[_nearest(self.positions[self.chosen], self.positions)]
        return normals if self.given is None else turned_towards(self.given, normals)


def _solid_witness(
    entry: _Entry,
    found: Reconstruction,
    owner: Integers,
    preparation: Preparation,
    settings: CloudSettings,
    start: float,
) -> Witness:
    cloud = found.cloud
    euler, agreement = tally(found.votes)
    inside = (found.cut if found.lids else found.cut_with(euler)).inside  # lids are facets of the first cut
    components, cavities = count_parts(cloud.complex_, inside)
    used = entry.kept[cloud.samples.kept]
    surface = cut_surface(cloud.complex_, inside, euler)
    return Witness(
        euler=euler,
        agreement=agreement,
        votes=found.votes,
        quality=found.quality,
        signs=found.signs,
        components=components,
        cavities=cavities,
        normals=entry.normals(found.signs, cloud.normals[owner]),
        n_points=len(entry.positions),
        n_used=len(used),
        spacing=cloud.local.spacing * entry.unit_length,
        resolution=found.resolution * entry.unit_length,
        seconds={
            "orientation": found.oriented_at - start,
            "votes": time.perf_counter() - found.oriented_at,
        },
        surface=replace(surface, points=used[surface.points]),
        preparation=preparation,
        is_shifted=found.is_shifted,
        is_smoothed=found.is_smoothed,
        rounding=entry.rounding,
        lids=tuple(replace(patch, samples=used[patch.samples]) for patch in found.lids),
        missed=np.delete(used, surface.points),
    )


def _wire_witness(
    entry: _Entry,
    patches: Patches,
    wire: WireReading,
    kept: Integers,
    owner: Integers,
    settings: CloudSettings,
    start: float,
) -> Witness:
    """The evidence about a thickened graph: no cuts and no fields, whose walls would be thinner than the spacing."""
    cloud, quality = entry.cloud, settings.quality
    outward, signs = wire.normals[owner], Signs("none", None, None)
    if cloud.normals is not None:
        outward = turned_towards(cloud.normals, outward)
        areas = patches.areas(cloud.normals)
        consistent = consistent_signs(cloud.points, cloud.normals, areas, patches.spacing, settings)
        signs = consistent if consistent is not None and cloud.oriented else Signs("axes", None, None)
    spacing = patches.spacing * (len(cloud.points) / len(kept)) ** 0.5
    wide = crowded_share(patches, outward, patches.areas(outward), kept, quality.feature, settings)
    return Witness(
        euler=wire.euler,
        agreement=wire.share,
        votes=(),
        quality=SampleQuality(1 - wire.n_stray / len(kept), patches.thickness / spacing, wide, 0.0),
        signs=signs,
        components=wire.components,
        cavities=0,
        normals=entry.normals(signs, outward),
        n_points=len(entry.positions),
        n_used=len(kept),
        spacing=spacing * entry.unit_length,
        resolution=spacing * entry.unit_length * quality.feature,
        seconds={"orientation": time.perf_counter() - start, "votes": 0.0},
        surface=None,
        preparation="wire" if len(kept) < len(cloud.points) else "whole",
        wire=wire,
        rounding=entry.rounding,
    )


def _stage_weights(n_points: int, settings: CloudSettings) -> Mapping[str, float]:
    """About how many seconds each stage takes on one processor, for the bar that shows progress."""
    millions, samples = n_points / 1e6, min(n_points, settings.sampling.samples) / 1e4
    return {
        "neighborhoods": 10 * millions,
        "signs": 3 * millions,
        "orientation": 0.5 * samples,
        "counting": 2 * samples + millions,
    }


def _nearest(targets: Floats, points: Floats) -> Integers:
    """Index of the nearest target (M, 3) of every point (N, 3)."""
    tree = cKDTree(targets, balanced_tree=False, compact_nodes=False)
    found = np.empty(len(points), dtype=np.int64)
    for rows in np.array_split(curve_order(points)[0], -(-len(points) // _QUERIES)):  # near each other: twice as fast
        found[rows] = nearest_in_tree(tree, points[rows], 1)
    return found


def _as_floats(values: Tensor) -> Floats:
    return np.ascontiguousarray(values.detach().cpu().double().numpy())


def _matching(values: Tensor, shape: tuple[int, ...], name: str) -> Floats:
    found = _as_floats(values)
    if found.shape != shape:
        raise InputError(f"the {name} have shape {found.shape}, but the points need {shape}.")
    if not np.isfinite(found).all():
        raise InputError(f"some {name} are not finite.")
    return found
