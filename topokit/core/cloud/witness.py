"""The global witness of a point cloud: outward normals, the votes on its Euler characteristic, and what supports them.

It returns numbers; `topokit.report.verdict` decides how far they may be believed.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from topokit.core.cloud.delaunay_cut import DelaunayComplex, count_parts, delaunay_complex, separating_faces
from topokit.core.cloud.downsampling import MOST_POINTS, downsample, spread_signs
from topokit.core.cloud.neighborhoods import (
    LocalGeometry,
    centered_positions,
    compatible_areas,
    local_geometry,
    project_to_planes,
    unit,
)
from topokit.core.cloud.orientation import check_normals, orient_samples
from topokit.core.cloud.votes import SampleQuality, Vote, gather_votes, tally
from topokit.core.cloud.wires import WireReading, read_wire
from topokit.core.threads import one_thread
from topokit.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
SignSource = Literal["given", "reversed", "contradictory", "axes", "none"]

_ROUGH = 0.5  # roughness from which a cloud may be looked at again, smoothed
_WIDE = 64  # neighbors of that smoothing
_CONTRADICTION = 0.5  # agreement below which the second look is taken
_UNANIMOUS = 0.9  # agreement of the smoothed cloud from which its integer is taken over
_SMALLEST_FEATURE = 2.5  # sample spacings that a feature must measure to be seen in clean samples
_BLUR = 2.0  # by how many spacings more for each spacing of roughness beyond that of clean samples
_CLEAN = 0.15  # roughness of clean samples of curved surfaces


@dataclass(frozen=True)
class Signs:
    """Where the outward directions came from.

    Attributes:
        source: "given" (as they came), "reversed" (they all pointed inward), "contradictory" (they disagreed, so signs
            were found), "axes" (given without signs), "none" (no normals were given).
        confirmed: share of the given normals that the points confirm, or None where signs were not given.
        coverage: share of the samples on the surface that the found directions imply, or None where none were found.
    """

    source: SignSource
    confirmed: float | None
    coverage: float | None


@dataclass(frozen=True)
class SmoothedLook:
    """A second look at a noisy cloud whose votes contradict each other, smoothed over wide neighborhoods.

    Attributes:
        euler: Euler characteristic of the surface that the smoothed points give.
        agreement: its share of the weight of all votes.
        n_neighbors: neighbors that each point was smoothed over.
    """

    euler: int
    agreement: float
    n_neighbors: int


@dataclass(frozen=True, eq=False)
class Witness:
    """The global evidence about the closed surface of a cloud.

    Attributes:
        euler: Euler characteristic of the surface.
        agreement: share of the weight of all votes that stands behind the heaviest integer.
        votes: Euler characteristic per setting.
        quality: how well the samples support the answer.
        signs: where the outward directions came from.
        smoothed: the second look, if its integer was taken over, else None.
        components: parts of the solid.
        cavities: holes wholly inside the solid; the surface has components + cavities components.
        normals: (N, 3), unit, outward, for every point given.
        n_points: points given.
        n_used: points used, after downsampling and without points that coincide with others.
        spacing: typical distance between the used points, in units of length.
        resolution: size of the smallest feature that the votes can see, in units of length.
        seconds: time per stage.
        faces: (F, 3), the surface of the first cut as triangles of the points given, not oriented; none if
            the integer is that of another reading.
        wire: the reading as a thickened graph, if its integer was taken over because the cloud is one-dimensional
            everywhere, else None.
    """

    euler: int
    agreement: float
    votes: tuple[Vote, ...]
    quality: SampleQuality
    signs: Signs
    smoothed: SmoothedLook | None
    components: int
    cavities: int
    normals: Floats
    n_points: int
    n_used: int
    spacing: float
    resolution: float
    seconds: dict[str, float]
    faces: Integers
    wire: WireReading | None = None

    @property
    def is_downsampled(self) -> bool:
        """Whether the cloud was too large to be used whole."""
        return self.n_points > MOST_POINTS


@dataclass(frozen=True, eq=False)
class _Cloud:
    """A cloud ready to be looked at: centered, scaled, downsampled.

    Attributes:
        positions: (N, 3), all points, centered, in units of `unit_length`.
        normals: (N, 3), unit, or None.
        unit_length: the unit of the positions, in units of length.
        kept: (M,), indices of the points that are used.
        areas: (M,), area per used point, or None.
    """

    positions: Floats
    normals: Floats | None
    unit_length: float
    kept: Integers
    areas: Floats | None

    @property
    def points(self) -> Floats:
        return self.positions[self.kept]


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

    Clouds of more than 30 000 points are downsampled evenly to about 20 000. Runs on the CPU, is deterministic, and is
    not differentiable.

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
    cloud = _prepare(points, normals, areas)
    local = local_geometry(cloud.points, cloud.areas)
    wire = read_wire(cloud.points)
    read = time.perf_counter()
    signs, outward, complex_ = _outward(cloud, local, oriented, wire)
    turned = time.perf_counter()
    weights = compatible_areas(outward, local) if areas is None else local.areas
    votes, quality, cut = gather_votes(cloud.points, outward, local, weights, complex_)
    components, cavities = count_parts(complex_, cut.inside)
    euler, agreement = tally(votes)
    voted = time.perf_counter()
    spacing = float(np.sqrt(weights.mean())) * cloud.unit_length
    witness = Witness(
        euler=euler,
        agreement=agreement,
        votes=votes,
        quality=quality,
        signs=signs,
        smoothed=None,
        components=components,
        cavities=cavities,
        normals=_normals_of_all(cloud, signs, outward),
        n_points=len(cloud.positions),
        n_used=len(cloud.kept),
        spacing=spacing,
        resolution=spacing * (_SMALLEST_FEATURE + _BLUR * max(quality.roughness - _CLEAN, 0.0)),
        seconds={
            "wire": read - start,
            "orientation": turned - read,
            "votes": voted - turned,
            "signs": time.perf_counter() - voted,
        },
        faces=cloud.kept[separating_faces(complex_, cut.inside)],
    )
    if wire is not None:
        return replace(
            witness, euler=wire.euler, components=wire.components, cavities=0, faces=witness.faces[:0], wire=wire
        )
    return _second_look(witness, cloud.points) if may_smooth else witness


def _prepare(points: Tensor, normals: Tensor | None, areas: Tensor | None) -> _Cloud:
    positions, unit_length = centered_positions(_as_floats(points))
    given = None if normals is None else unit(_matching(normals, positions.shape, "normals"))
    scaled = None if areas is None else _matching(areas, positions.shape[:1], "areas") / unit_length**2
    kept, kept_areas = downsample(positions, scaled)
    return _Cloud(positions, given, unit_length, kept, kept_areas)


def _outward(
    cloud: _Cloud, local: LocalGeometry, oriented: bool, wire: WireReading | None
) -> tuple[Signs, Floats, DelaunayComplex]:
    """Outward normals (M, 3) of the used points, where their signs came from, and the tetrahedra built on the way."""
    source: SignSource = "none" if cloud.normals is None else "axes"
    confirmed = None
    given = None if cloud.normals is None else cloud.normals[cloud.kept]
    if given is not None and oriented:
        complex_ = delaunay_complex(cloud.points, local.spacing)
        kind, confirmed = check_normals(cloud.points, given, compatible_areas(given, local), local, complex_)
        if kind != "mixed":
            source, sign = ("given", 1.0) if kind == "outward" else ("reversed", -1.0)
            return Signs(source, confirmed, None), sign * given, complex_
        source = "contradictory"
    if wire is not None:
        outward = wire.normals if given is None else _signed(given, wire.normals)
        return Signs(source, confirmed, None), outward, delaunay_complex(cloud.points, local.spacing)
    found = orient_samples(cloud.points, local)
    outward = found.normals if given is None else _signed(given, found.normals)
    return Signs(source, confirmed, found.coverage), outward, found.complex_


def _normals_of_all(cloud: _Cloud, signs: Signs, outward: Floats) -> Floats:
    """Outward unit normals (N, 3) for all points, from those of the used points."""
    if len(cloud.kept) == len(cloud.positions):
        return outward
    if cloud.normals is not None and signs.source in ("given", "reversed"):
        return cloud.normals if signs.source == "given" else -cloud.normals
    spread = spread_signs(cloud.positions, cloud.kept, outward)
    return spread if cloud.normals is None else _signed(cloud.normals, spread)


def _second_look(witness: Witness, points: Floats) -> Witness:
    """Where noise exceeds the spacing and the votes contradict each other, look again at smoothed points.

    The points are projected onto the planes of wide neighborhoods. Their integer is taken over if nearly all votes then
    agree.
    """
    noisy = witness.quality.roughness >= _ROUGH and witness.agreement < _CONTRADICTION
    if not noisy or len(points) <= _WIDE:
        return witness
    again = global_witness(torch.from_numpy(project_to_planes(points, _WIDE)), may_smooth=False)
    if again.agreement < _UNANIMOUS:
        return witness
    return replace(
        witness,
        euler=again.euler,
        smoothed=SmoothedLook(again.euler, again.agreement, _WIDE),
        components=again.components,
        cavities=again.cavities,
        resolution=witness.resolution * _WIDE**0.5,
        faces=witness.faces[:0],
    )


def _signed(axes: Floats, directions: Floats) -> Floats:
    """The axes (N, 3), each turned towards its direction."""
    return np.where((axes * directions).sum(1, keepdims=True) < 0, -axes, axes)


def _as_floats(values: Tensor) -> Floats:
    return np.ascontiguousarray(values.detach().cpu().double().numpy())


def _matching(values: Tensor, shape: tuple[int, ...], name: str) -> Floats:
    found = _as_floats(values)
    if found.shape != shape:
        raise InputError(f"the {name} have shape {found.shape}, but the points need {shape}.")
    if not np.isfinite(found).all():
        raise InputError(f"some {name} are not finite.")
    return found
