"""What is measured on the samples of a shape, at fixed settings, whatever the caller's own settings are."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.caps import OrientedLayer, flat_share, planar_caps
from topokit.core.cloud.guards import far_points
from topokit.core.cloud.outliers import outliers
from topokit.core.cloud.sampling.downsampling import thin_along_curve
from topokit.core.cloud.settings import SamplingSettings, WireSettings
from topokit.core.cloud.sheets import SheetReading, read_sheet
from topokit.core.cloud.witness import Witness, global_witness
from topokit.core.local.boundary import BoundaryEstimate, estimate_boundary
from topokit.core.local.curvature import DEFAULT_NEIGHBORS, Curvature, CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.local.neighborhood_size import automatic_neighbors
from topokit.core.neighbors import first_neighbors, nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.core.scale.narrow_places import NarrowPlace
from topokit.core.surface import TriangleSurface, vector_areas
from topokit.errors import InputError, TopokitError
from topokit.report.doubts import cloud_doubts
from topokit.report.progress import progress_bar
from topokit.report.verdict import (
    THRESHOLDS,
    Check,
    cloud_checks,
    cloud_verdict,
    is_mostly_seen,
    is_open,
    is_sheet,
    lids,
    missing_samples,
    opacity_decides,
    wire_checks,
    without_doubts,
)

if TYPE_CHECKING:
    from topokit.core.opacity.scene import AbsorbingScene
    from topokit.core.opacity.solid import OpacityReading

_SUPPLIED = 0.5  # share of the samples missing from holes that caps or flat lids must have, and another round once more
_COVERED = 0.9  # share of the lids over holes near which other splats are, from which light may not enter there
_COVERING = 1.5  # spacings of samples within which these are
_FEWEST_FOR_BAR = 3_000  # points that may take longer than the patience of a bar


class Examination:
    """The measurements behind the verdict on one sampled surface, each made once, when it is first needed.

    Nothing here depends on the number of neighbors that a user chooses for curvature, nor on the order of questions.
    """

    def __init__(
        self,
        samples: SurfaceSamples,
        *,
        known_closed: bool,
        neighbors: Callable[[], Tensor] | None = None,
        opacity: AbsorbingScene | None = None,
    ) -> None:
        """
        Args:
            samples: of one surface, (N, 3); detached.
            known_closed: whether the surface is known to have no boundary, so that none is looked for.
            neighbors: returns what `neighbors` would find, if that is known already.
            opacity: the scene that absorbs light, if the samples are of one.
        """
        self._scene = opacity
        self.samples = samples
        self._known_closed = known_closed
        self._find_neighbors = neighbors or self._search
        self.estimate_seconds = 0.0  # that neighbors, curvature and boundary took

    @cached_property
    def neighbors(self) -> Tensor:
        """(N, k) indices of the nearest neighbors; k = 20, or as many as there are."""
        return self._find_neighbors()

    def _search(self) -> Tensor:
        points = self.samples.points
        with torch.inference_mode(False):  # the indices outlive the mode, and gradients must be able to save them
            return nearest_neighbors(points, min(DEFAULT_NEIGHBORS, len(points) - 1))

    @cached_property
    def _near(self) -> Tensor | None:
        """Indices of the points that are on the surface, or None if all are."""
        points = self.samples.points
        near = (~far_points(points)).nonzero().squeeze(1)
        near = near[~outliers(points[near])]
        return near if len(near) < len(points) else None

    @property
    def _on_surface(self) -> SurfaceSamples:
        """The samples without outliers."""
        return self.samples if self._near is None else self.samples.at(self._near)

    @property
    def n_outliers(self) -> int:
        """Number of outliers, which are left out of everything but `neighbors` and `curvature`."""
        return 0 if self._near is None else self.samples.n_points - len(self._near)

    @cached_property
    def part(self) -> Examination:
        """The measurements of at most 30 000 points, evenly many along a curve: enough for sums and boundaries."""
        thin = _thinned(self._on_surface, SamplingSettings().whole)
        return self if thin is self.samples else Examination(thin, known_closed=self._known_closed)

    @cached_property
    def curvature(self) -> Curvature:
        """Curvature of the samples by the defaults of `Shape.curvature`, without a graph."""
        with torch.no_grad(), self._timed():
            settings = CurvatureSettings(automatic_neighbors(self.samples.points, self.neighbors))
            known = first_neighbors(self.neighbors, settings.n_neighbors)
            return surface_curvature(self.samples, settings, neighbors=known)

    @cached_property
    def boundary(self) -> BoundaryEstimate:
        """The boundary curves of the surface."""
        if self._known_closed:
            return BoundaryEstimate((), 0.0, float(self.curvature.area.mean().sqrt()))
        with self._timed():
            return estimate_boundary(self.samples.points, self.neighbors)

    @cached_property
    def sheet(self) -> SheetReading | None:
        """The union of balls around the samples of the part; None if they are too few."""
        part = self.part
        return read_sheet(part.samples.points, part.neighbors, WireSettings())

    @contextmanager
    def _timed(self) -> Iterator[None]:
        started = time.perf_counter()
        yield
        self.estimate_seconds += time.perf_counter() - started

    @cached_property
    def estimate(self) -> float:
        """χ⁽⁰⁾, with the turning of the boundary, as `Shape.gauss_bonnet` gives it."""
        return float(euler_characteristic(self.curvature.gaussian, self.curvature.area)) + self.boundary.euler

    def _measure_part(self) -> BoundaryEstimate:
        """The boundary of the part; its curvature, which every report needs, is measured with it."""
        part = self.part
        _ = part.estimate
        return part.boundary

    @cached_property
    def _witness_or_refusal(self) -> Witness | InputError:
        samples = self._on_surface
        with (
            progress_bar([f"{samples.n_points} points"] if samples.n_points >= _FEWEST_FOR_BAR else []),
            ThreadPoolExecutor(1) as thread,
        ):  # beside the witness, which uses one processor most of the time
            thread.submit(self._measure_part)
            try:
                found = global_witness(samples.points, samples.known_normals(), oriented=samples.oriented)
            except InputError as refusal:
                return refusal
        return found if self._near is None else _for_all_points(found, self._near, self.samples.points)

    @property
    def witness(self) -> Witness | None:
        """The global witness, or None if the points bound no solid."""
        found = self._witness_or_refusal
        return found if isinstance(found, Witness) else None

    @cached_property
    def surface(self) -> TriangleSurface | None:
        """The closed surface of the witness, whose vertices are samples, facing outward; None if there is none."""
        surface = None if self.witness is None else self.witness.surface
        if surface is None or len(surface.faces) == 0:
            return None
        return TriangleSurface(self.positions(surface.points), surface.faces)

    def positions(self, rows: Integers) -> Floats:
        """Samples (M, 3) by their indices, in double precision."""
        found: Floats = self.samples.points.detach().cpu()[torch.from_numpy(rows)].double().numpy()
        return found

    @cached_property
    def capped(self) -> Examination | None:
        """The measurements with planar caps over the holes of a solid; None without holes, or if caps leave it open."""
        witness, surface, points = self.witness, self.surface, self.samples.points
        covers = lids(witness)
        if witness is None or surface is None or not covers or not is_mostly_seen(witness):
            return None
        holes = [surface.vertices[surface.faces[patch.facets]] for patch in covers]
        layer = self._outward_layer(witness)
        caps, directions = planar_caps(layer, holes)
        flat = sum(patch.missing * flat_share(hole, layer.spacing) for patch, hole in zip(covers, holes, strict=True))
        if len(caps) == 0 or max(len(caps), flat) < _SUPPLIED * missing_samples(witness):
            return None  # most holes are not flat; under a ring the lid is flat, but its cap is smaller
        normals = torch.from_numpy(np.concatenate((witness.normals, directions))).to(points)
        samples = SurfaceSamples(torch.cat((points, torch.from_numpy(caps).to(points))), normals)
        found = Examination(samples, known_closed=False)
        if not is_open(found.part.boundary, found.witness):
            return found
        is_better = missing_samples(found.witness) < (1 - _SUPPLIED) * missing_samples(witness)
        return found.capped if is_better else None

    def _outward_layer(self, witness: Witness) -> OrientedLayer:
        """At most as many of the points on the surface as a cut has, with the directions of the witness."""
        outward = torch.from_numpy(witness.normals).to(self.samples.points)
        oriented = replace(self.samples, normals=outward, frames=None, oriented=True)
        near = oriented if self._near is None else oriented.at(self._near)
        thin = _thinned(near, SamplingSettings().samples)
        assert thin.normals is not None, "they were given above"
        area = Examination(thin, known_closed=True).curvature.area
        return OrientedLayer(*(part.cpu().double().numpy() for part in (thin.points, thin.normals, area)))

    @cached_property
    def _doubts_or_refusal(self) -> tuple[NarrowPlace, ...] | TopokitError:
        try:
            if self.witness is None or self.surface is None:
                raise InputError("no closed surface was found.")
            return cloud_doubts(self.witness, self.surface, self.positions(self.witness.missed))
        except TopokitError as refusal:
            return refusal

    @property
    def doubts(self) -> tuple[NarrowPlace, ...] | None:
        """Where the answer may be wrong, or None if that cannot be told."""
        found = self._doubts_or_refusal
        return found if isinstance(found, tuple) else None

    @property
    def doubts_refusal(self) -> TopokitError | None:
        """Why it cannot be told where the answer may be wrong, or None."""
        found = self._doubts_or_refusal
        return None if isinstance(found, tuple) else found

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """The conditions under which the integer of a closed surface is likely, by samples alone; none without it."""
        witness = self.witness
        if witness is None or (is_open(self.part.boundary, witness) and witness.wire is None):
            return ()
        if witness.wire is not None:
            return wire_checks(witness, witness.wire)
        checks = cloud_checks(witness, self.part.boundary)
        is_settled = cloud_verdict(checks) == "unsure" and self.doubts == ()
        return without_doubts(checks) if is_settled else checks

    @cached_property
    def opacity(self) -> OpacityReading | None:
        """The solid that cannot be seen into, looked for where samples are unsure, may be too coarse, or have holes.

        Holes must be covered by splats that are no samples: otherwise light enters, and only walls are left.
        """
        scene, witness = self._scene, self.witness
        if scene is None or witness is None or witness.wire is not None:
            return None
        if not self.checks and not self._has_covered_holes(scene.make().means, _COVERING * witness.spacing):
            return None
        is_unsure = bool(self.checks) and cloud_verdict(self.checks) == "unsure"
        return scene.read(None if is_unsure else THRESHOLDS["finer"].value * witness.resolution)

    @cached_property
    def opaque(self) -> OpacityReading | None:
        """That solid, if the integer is its own and not that of the samples."""
        seen, witness = self.opacity, self.witness
        if seen is None or witness is None or not opacity_decides(seen, witness, is_open=not self.checks):
            return None
        if seen.surface is None or self.checks:
            return seen
        is_covered = self._has_covered_holes(torch.from_numpy(seen.surface.vertices), seen.resolution)
        return seen if is_covered else None

    def _has_covered_holes(self, places: Tensor, within: float) -> bool:
        """Whether there are holes, and places (P, 3) lie near nearly all of the lids over them."""
        surface, covers = self.surface, lids(self.witness)
        if surface is None or not covers:
            return False
        corners = surface.vertices[surface.faces[np.concatenate([patch.facets for patch in covers])]]
        areas = np.linalg.norm(vector_areas(corners), axis=1)
        distances = cKDTree(places.detach().cpu().double().numpy()).query(corners.mean(1))[0]
        return float(areas[distances < within].sum()) > _COVERED * float(areas.sum())

    def smoothed_opaque_euler(self) -> Tensor | None:
        """χ_τ of that solid, differentiable; None if the integer is not its own, or there is no graph."""
        return None if self._scene is None or self.opaque is None else self._scene.smoothed_euler()

    @property
    def refusal(self) -> InputError | None:
        """Why there is no global witness, or None."""
        found = self._witness_or_refusal
        return found if isinstance(found, InputError) else None


def _thinned(samples: SurfaceSamples, most: int) -> SurfaceSamples:
    """At most so many of the samples, evenly many along a curve, with areas in proportion."""
    if samples.n_points <= most:
        return samples
    rows = thin_along_curve(samples.points.cpu().double().numpy(), most)
    thin = samples.at(torch.from_numpy(rows).to(samples.points.device))
    return thin if thin.areas is None else replace(thin, areas=thin.areas * (samples.n_points / thin.n_points))


def _for_all_points(found: Witness, near: Tensor, points: Tensor) -> Witness:
    """The witness of the near points as one of all points; far ones have the direction away from the others."""
    rows = near.cpu().numpy()
    away = points.detach().double() - points[near].detach().double().mean(0)
    normals = torch.nn.functional.normalize(away, dim=1).cpu().numpy()
    normals[rows] = found.normals
    surface = None if found.surface is None else replace(found.surface, points=rows[found.surface.points])
    covers = tuple(replace(patch, samples=rows[patch.samples]) for patch in found.lids)
    return replace(found, normals=normals, surface=surface, lids=covers, missed=rows[found.missed])


def solid_eulers(found: tuple[Examination, ...]) -> list[int] | None:
    """The integer of each batch item's witness; None if one bounds no solid or is an open sheet."""
    eulers = []
    for one in found:
        boundary, witness = one.part.boundary, one.witness
        turning_is_unknown = bool(lids(witness)) and not boundary.curves
        if one.opaque is not None:
            eulers.append(one.opaque.euler)
        elif witness and not is_sheet(witness) and not turning_is_unknown:
            eulers.append(witness.euler)
    return eulers if len(eulers) == len(found) else None


def outward_samples(samples: SurfaceSamples, normals: Tensor, found: tuple[Examination, ...]) -> SurfaceSamples:
    """Samples with unit normals (..., N, 3), turned outward where the samples have no signs of their own.

    Differentiable in points and normals. If an item bounds no solid, all keep normals without signs.

    Raises:
        InputError: if the samples are a batch with padding.
    """
    if samples.lengths is not None:
        raise InputError("the clouds of this batch have different sizes: make a shape of each to orient or refine it.")
    if samples.oriented:
        return SurfaceSamples(samples.points, normals, areas=samples.areas)
    directions = [one.witness.normals for one in found if one.witness]
    if len(directions) < len(found):
        return SurfaceSamples(samples.points, normals, areas=samples.areas, oriented=False)
    outward = torch.from_numpy(np.stack(directions)).to(normals).reshape(normals.shape)
    sides = (normals.detach() * outward).sum(-1, keepdim=True)
    sign = torch.where(sides < 0, -1.0, 1.0).to(normals)
    return SurfaceSamples(samples.points, sign * normals, areas=samples.areas)
