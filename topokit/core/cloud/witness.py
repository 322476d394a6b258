"""The global witness: one integer, how many settings agree on it, and sentences that say why.

Two independent families look at the same oriented samples: winding-number fields on grids (several cells and
smoothings), and minimum cuts of Delaunay tetrahedra (several weights, raw and smoothed positions, closed inside and
closed outside). The Euler characteristic of the surface is twice that of the solid. `verdict` holds the rule.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from topokit.core.cloud.delaunay_cut import (
    CutWeights,
    DelaunayComplex,
    count_parts,
    cut_complex,
    delaunay_complex,
    separating_faces,
    solid_eulers,
)
from topokit.core.cloud.downsampling import MOST_POINTS, spread_signs, thin
from topokit.core.cloud.neighborhoods import (
    LocalGeometry,
    centered_positions,
    compatible_areas,
    crowded_share,
    disagreement,
    flatten,
    local_geometry,
    projected,
    unit,
)
from topokit.core.cloud.orientation import check_normals, orient_samples
from topokit.core.cloud.votes import Verdict, decide
from topokit.core.grid.euler import solid_euler
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.errors import InputError

_ROUGH = 0.5  # distance of points from the local plane, in spacings, from which smoothing may help
_WIDE = 64  # neighbors that very noisy points are smoothed over
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

GRID_SETTINGS = ((1.5, 1.5, 128**3), (2.0, 1.5, 160**3), (2.0, 2.5, 160**3))
"""Cells per spacing, Gaussian in cells, most vertices."""

CUT_SETTINGS = (CutWeights(0.5, 3.0, 4.0), CutWeights(1.5, 3.0, 6.0), CutWeights(0.3, 2.0, 2.0))


@dataclass(frozen=True, eq=False)
class Witness:
    """What the global witness says.

    Attributes:
        euler: Euler characteristic of the surface.
        verdict: "likely" or "unsure".
        reasons: plain sentences with their numbers.
        votes: Euler characteristic per setting.
        components: parts of the solid.
        cavities: holes wholly inside the solid; the surface has components + cavities components.
        normals: (N, 3), unit, outward: those given or their opposites, or those found; for every point given.
        spacing: typical distance between the samples that were looked at, in units of the points.
        resolution: size of the smallest feature that the settings can see, in units of the points.
        numbers: what the rule looked at.
        seconds: time per stage.
        faces: (F, 3), the surface of the first cut as triangles of the points given; not oriented.
    """

    euler: int
    verdict: Verdict
    reasons: tuple[str, ...]
    votes: dict[str, int]
    components: int
    cavities: int
    normals: Floats
    spacing: float
    resolution: float
    numbers: dict[str, float]
    seconds: dict[str, float]
    faces: Integers


def global_witness(
    points: Tensor,
    normals: Tensor | None = None,
    areas: Tensor | None = None,
    *,
    oriented: bool = True,
    may_smooth: bool = True,
) -> Witness:
    """The integer of a cloud's closed surface, and how far it may be believed.

    Of more than 30 000 points about 20 000, evenly spread, are looked at, and `reasons` says so. Runs on the CPU, is
    deterministic, and is not differentiable.

    Args:
        points: (N, 3) samples of a surface, any float dtype and device.
        normals: (N, 3), any positive length, outward; found when absent, turned when they all point inward, reported
            when they contradict each other.
        oriented: whether the normals' signs mean anything; if not, the normals are axes whose signs are found.
        may_smooth: whether a cloud noisier than its spacing may be asked again about smoothed points.
        areas: (N,), surface area that each sample stands for, best exact tangent Voronoi areas; estimated when absent.

    Raises:
        InputError: for fewer than 32 points, points that are not finite, in a plane, on a line or in one place, and for
            normals or areas that do not fit the points or are not finite.
    """
    start = time.perf_counter()
    positions, unit_length = centered_positions(_as_floats(points))
    given = None if normals is None else unit(_fitting(normals, positions.shape, "normals"))
    scaled = None if areas is None else _fitting(areas, positions.shape[:1], "areas") / unit_length**2
    kept, kept_areas = thin(positions, scaled)
    chosen = positions[kept]
    local = local_geometry(chosen, areas=kept_areas)
    notes: list[str] = []
    extra: dict[str, float] = {}
    sign = 1.0
    if len(positions) > MOST_POINTS:
        notes.append(
            f"Of {len(positions)} points {len(kept)}, evenly spread, were looked at; "
            "what is smaller than their spacing is not seen."
        )
    elif len(kept) < len(positions):
        notes.append(f"{len(positions) - len(kept)} points lie where others do and were left out.")
    has_signs = given is not None and oriented
    if given is not None and has_signs:
        complex_ = delaunay_complex(chosen, local.spacing)
        kind, confirmed, said = _check_given(chosen, given[kept], local, complex_)
        extra["given normals"] = confirmed
        notes += said
        sign = -1.0 if kind == "inward" else 1.0
        has_signs = kind != "mixed"
    if given is not None and has_signs:
        outward = sign * given[kept]
    else:
        found = orient_samples(chosen, local)
        complex_ = found.complex_
        outward = found.normals if given is None else _signed(given[kept], found.normals)
        what = "No normals were given; they" if given is None else "The signs of the normals"
        notes.append(
            f"{what} were found from the points "
            f"({found.coverage:.0%} of which lie on the surface that those normals imply)."
        )
    turned = time.perf_counter()
    weights = local.areas if areas is not None else compatible_areas(outward, local)
    votes, numbers, inside = gather_votes(chosen, outward, local, weights, complex_)
    components, cavities = count_parts(complex_, inside)
    numbers.update(extra)
    euler, verdict, reasons, numbers["agreement"] = decide(votes, numbers)
    voted = time.perf_counter()
    spacing = float(np.sqrt(weights.mean())) * unit_length
    if len(kept) < len(positions):
        if given is not None and has_signs:
            outward = sign * given
        else:
            spread = spread_signs(positions, kept, outward)
            outward = spread if given is None else _signed(given, spread)
    seconds = {
        "orientation": turned - start,
        "votes": voted - turned,
        "spreading": time.perf_counter() - voted,
    }
    witness = Witness(
        euler=euler,
        verdict=verdict,
        reasons=(*notes, *reasons),
        votes=votes,
        components=components,
        cavities=cavities,
        normals=outward,
        spacing=spacing,
        resolution=spacing * (2.5 + 2 * max(local.roughness - 0.15, 0.0)),
        numbers=numbers,
        seconds=seconds,
        faces=kept[separating_faces(complex_, inside)],
    )
    return _second_look(witness, chosen, local) if may_smooth else witness


def _second_look(witness: Witness, points: Floats, local: LocalGeometry) -> Witness:
    """Where noise exceeds the spacing and the settings contradict each other, ask again about smoothed points.

    The points are moved onto the planes of wide neighborhoods. The integer is taken over if (nearly) all settings then
    agree; the verdict stays "unsure", since details went with the noise.
    """
    if local.roughness < _ROUGH or witness.numbers["agreement"] >= 0.5 or len(points) <= _WIDE:
        return witness
    again = global_witness(torch.from_numpy(projected(points, _WIDE)), may_smooth=False)
    agreement = again.numbers["agreement"]
    if agreement < 0.9:
        return witness
    note = (
        f"The noise is about as large as the sample spacing; smoothed over {_WIDE} neighbors, the points give "
        f"χ = {again.euler} in {agreement:.0%} of all evidence."
    )
    return replace(
        witness,
        euler=again.euler,
        verdict="unsure",
        reasons=(note, *witness.reasons),
        components=again.components,
        cavities=again.cavities,
        resolution=witness.resolution * _WIDE**0.5,
        faces=witness.faces[:0],
    )


def gather_votes(
    points: Floats, normals: Floats, local: LocalGeometry, areas: Floats, complex_: DelaunayComplex
) -> tuple[dict[str, int], dict[str, float], Booleans]:
    """What every setting says about oriented samples.

    Args:
        points: (N, 3), centered, of moderate extent.
        normals: (N, 3), unit, outward.
        local: neighborhoods of the points.
        areas: (N,).
        complex_: tetrahedra of the points.

    Returns:
        Euler characteristic of the surface per setting, measurements for the rule, and which tetrahedra the first cut
        puts inside (T,).
    """
    votes: dict[str, int] = {}
    spacing = float(np.sqrt(areas.mean()))
    cuts = [cut_complex(complex_, normals, weights) for weights in CUT_SETTINGS]
    for k, cut in enumerate(cuts):
        _vote(votes, f"cut {k}", solid_eulers(complex_, cut.inside))
    smooth = delaunay_complex(flatten(points, normals, local), spacing)
    for k, weights in enumerate(CUT_SETTINGS[:2]):
        _vote(votes, f"smooth cut {k}", solid_eulers(smooth, cut_complex(smooth, normals, weights).inside))
    p, n, a = (torch.as_tensor(values, dtype=torch.float32) for values in (points, normals, areas))
    for k, (per_spacing, sigma, most) in enumerate(GRID_SETTINGS):
        field = winding_field(p, n, a, make_grid(p, spacing, per_spacing, most), sigma)
        votes[f"grid {k}"] = 2 * int(solid_euler(field.values, 0.5, connectivity=6))
    numbers = {
        "energy": cuts[0].energy,
        "coverage": cuts[0].coverage,
        "disagreement": disagreement(normals, local.index),
        "roughness": local.roughness,
        "crowded": crowded_share(points, normals, spacing),
        "crowded 2.5": crowded_share(points, normals, spacing, 2.5),
    }
    return votes, numbers, cuts[0].inside


def _vote(votes: dict[str, int], name: str, eulers: tuple[int, int]) -> None:
    votes[f"{name} inside"], votes[f"{name} outside"] = 2 * eulers[0], 2 * eulers[1]


def _check_given(
    points: Floats, normals: Floats, local: LocalGeometry, complex_: DelaunayComplex
) -> tuple[Literal["outward", "inward", "mixed"], float, list[str]]:
    """Where given normals point, the share that is confirmed, and what there is to say."""
    kind, confirmed = check_normals(points, normals, compatible_areas(normals, local), local, complex_)
    if kind == "mixed":
        said = f"The given normals contradict each other: {1 - confirmed:.0%} point the wrong way."
        return kind, min(confirmed, 0.89), [said]
    if kind == "inward":
        said = f"The given normals all point inward ({confirmed:.0%} of them agree); they were turned round."
        return kind, confirmed, [said]
    return kind, confirmed, []


def _signed(axes: Floats, directions: Floats) -> Floats:
    """The axes (N, 3), each turned to the side of its direction."""
    return np.where((axes * directions).sum(1, keepdims=True) < 0, -axes, axes)


def _as_floats(values: Tensor) -> Floats:
    return np.ascontiguousarray(values.detach().cpu().double().numpy())


def _fitting(values: Tensor, shape: tuple[int, ...], name: str) -> Floats:
    found = _as_floats(values)
    if found.shape != shape:
        raise InputError(f"the {name} have shape {found.shape}, but the points need {shape}.")
    if not np.isfinite(found).all():
        raise InputError(f"some {name} are not finite.")
    return found
