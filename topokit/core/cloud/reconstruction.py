"""One reconstruction of a cloud: signs at full density, samples where features are small, tetrahedra, votes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.given_normals import Signs, compared_signs, consistent_signs
from topokit.core.cloud.normals.creases import find_faces
from topokit.core.cloud.normals.patches import Patches, turned_towards
from topokit.core.cloud.normals.propagation import propagate_signs
from topokit.core.cloud.orientation import Orientation, orient_samples
from topokit.core.cloud.sampling.samples_of_large_clouds import Sampler
from topokit.core.cloud.settings import CloudSettings
from topokit.core.cloud.solid.tetrahedra import Cut
from topokit.core.cloud.solid.uncovered import UncoveredPatch, uncovered_patches
from topokit.core.cloud.votes import (
    OrientedCloud,
    SampleQuality,
    Vote,
    complex_of,
    gather_votes,
    sample_quality,
    surface_eulers,
)
from topokit.core.progress import begin


@dataclass(frozen=True, eq=False)
class Cloud:
    """Distinct points, centered and scaled.

    Attributes:
        points: (N, 3), in units of a power of two near the length of the cloud.
        normals: (N, 3), unit, or None.
        oriented: whether the signs of the normals mean anything.
    """

    points: Floats
    normals: Floats | None
    oriented: bool

    @property
    def signed(self) -> Floats | None:
        """The normals if their signs mean anything, or None."""
        return self.normals if self.oriented else None

    def at(self, moved: Floats, kept: Integers) -> Cloud:
        """Some of its points at other positions."""
        return Cloud(moved, None if self.normals is None else self.normals[kept], self.oriented)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What one reconstruction found.

    Attributes:
        cloud: points with outward normals, and the samples among them.
        patches: neighborhoods of the points.
        signs: where the outward directions came from.
        found: the orientation; None if the given signs are used.
        votes: of every setting.
        cuts: of all samples, one for each setting.
        quality: how well the samples support the answer.
        oriented_at: when the normals were known, on the clock of `time.perf_counter`.
        settings: with which it was found.
        is_shifted: whether the samples were shifted along their normals.
        is_smoothed: whether votes of smoothed samples were added.
        blur: width of the details that were averaged away with the noise before, in units of length.
    """

    cloud: OrientedCloud
    patches: Patches
    signs: Signs
    found: Orientation | None
    votes: tuple[Vote, ...]
    cuts: tuple[Cut, ...]
    quality: SampleQuality
    oriented_at: float
    settings: CloudSettings
    is_shifted: bool = False
    is_smoothed: bool = False
    blur: float = 0.0

    @property
    def cut(self) -> Cut:
        """The first one."""
        return self.cuts[0]

    def cut_with(self, euler: int) -> Cut:
        """The first cut with a surface of an Euler characteristic, from inside or outside; else the first of all.

        A cut with nothing inside has χ = 0, too, but no surface.
        """
        solid = (cut for cut in self.cuts if cut.inside.any())
        return next((cut for cut in solid if euler in surface_eulers(self.cloud.complex_, cut)), self.cut)

    @property
    def has_given_signs(self) -> bool:
        """Whether the outward directions are those of the given normals."""
        return self.found is None

    @cached_property
    def lids(self) -> tuple[UncoveredPatch, ...]:
        """The patches of the found surface that cover holes of the cloud, largest first.

        Noise leaves gaps in the surface that was found, too: with it, holes must be wider in proportion to the smallest
        feature that is seen.
        """
        own, cloud = self.settings.quality, self.cloud
        normals = cloud.normals[cloud.samples.kept]
        patches = uncovered_patches(cloud.complex_, self.cut.inside, cloud.points, normals, own)
        least = self._least_missing
        return tuple(patch for patch in patches if patch.missing > least)

    @property
    def has_holes(self) -> bool:
        """Whether so many samples are missing where no point is near, so that no other cut can do without that lid."""
        least = self._least_missing
        return any(patch.empty > least for patch in self.lids)

    @property
    def _least_missing(self) -> float:
        """Samples missing from a lid over a hole, more than these."""
        own = self.settings.quality
        return own.lid * (self._feature / own.feature) ** 2

    @property
    def resolution(self) -> float:
        """Width of the narrowest feature that is seen wherever it is: samples may be sparse there.

        Many points around few samples show where features are small, so that samples are dense there.
        """
        local, own = self.cloud.local, self.settings.quality
        blur = (self._feature - own.feature) * local.spacing
        return own.feature * max(local.finest, self.patches.coarsest) + blur

    @property
    def _feature(self) -> float:
        """Width of the narrowest feature that is seen where samples are spaced as usual, in their spacings."""
        own, blur = self.settings.quality, self.blur / self.cloud.local.spacing
        return own.feature + own.blur * max(self.quality.roughness - own.clean, 0.0) + blur


def reconstruct(cloud: Cloud, patches: Patches, settings: CloudSettings, blur: float = 0.0) -> Reconstruction:
    """Reconstruct the surface of a cloud.

    Args:
        cloud: with more than ten points.
        patches: neighborhoods of its points.
        settings: see there.
        blur: width of the details that were averaged away with the noise before, in units of length.
    """
    begin("signs")
    oriented, signs, found = _oriented(cloud, patches, settings)
    oriented_at = time.perf_counter()
    begin("counting")
    votes, cuts = gather_votes(oriented, settings)
    quality = sample_quality(oriented, patches, cuts[0], settings)
    return Reconstruction(oriented, patches, signs, found, votes, cuts, quality, oriented_at, settings, blur=blur)


def _oriented(
    cloud: Cloud, patches: Patches, settings: CloudSettings
) -> tuple[OrientedCloud, Signs, Orientation | None]:
    """The cloud with outward normals, where their signs came from, and the orientation if one had to be found."""
    points, given = cloud.points, cloud.normals
    if given is not None and cloud.oriented:
        own = patches.areas(given)
        consistent = consistent_signs(points, given, own, patches.spacing, settings)
        outward = None if consistent is None else consistent.apply(given)
        if consistent is not None and outward is not None:
            sampler = Sampler(points, outward, patches.areas(), patches.thickness, settings)
            samples = sampler.samples()
            local, complex_ = complex_of(points[samples.kept], settings)
            return OrientedCloud(points, outward, own, sampler, samples, local, complex_), consistent, None
    faces, areas = find_faces(patches, settings.creases), patches.areas()
    axes = faces.sharpened(patches.planes.axes) if given is None else given
    carried = None
    if patches.roughness <= settings.signs.roughness:
        carried = propagate_signs(points, axes, areas, patches.neighbors, by_vote=faces.show, settings=settings.signs)
    sampler = Sampler(points, None if carried is None else carried.normals, areas, patches.thickness, settings)
    samples = sampler.samples(given, carried, faces)
    local, complex_ = complex_of(points[samples.kept], settings)
    begin("orientation")
    found = orient_samples(samples, local, complex_, settings)
    signs = Signs("none" if given is None else "axes", None, found.coverage)
    if given is not None and cloud.oriented:
        signs = compared_signs(given[samples.kept], found, complex_, settings)
    outward = signs.apply(given)
    if outward is None:
        outward = samples.spread(found.normals, axes if carried is None else carried.normals)
        outward = outward if given is None else turned_towards(given, outward)
    areas = patches.areas(outward)
    used = None if signs.coverage is None else found
    return OrientedCloud(points, outward, areas, sampler, samples, local, complex_), signs, used
