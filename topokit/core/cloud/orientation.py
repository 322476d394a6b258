"""Outward normals for unoriented samples, and a check of given ones.

The winding number of a closed surface is one half on the surface. Solving w(pᵢ) = ½ for dipole vectors by regularized
conjugate gradients in a Fourier operator needs no normals; a few rounds of one steepest-descent step and a turn of
every dipole along −∇w sharpen the result. This is done on a coarse grid (robust to noise) and on one as fine as the
sample spacing (right on thin sheets). The candidates are averaged over neighbors that agree and compared by the cost of
the best solid that they imply (`delaunay_cut`). Smooth samples need none of this: signs carried along the surface
are believed if the solid that they imply agrees with all of them.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from topokit.core.cloud.delaunay_cut import Cut, DelaunayComplex, cut_complex, delaunay_complex, surface_normals
from topokit.core.cloud.dipoles import DipoleSolver, border_mean
from topokit.core.cloud.neighborhoods import LocalGeometry, clean_normals, unit
from topokit.core.cloud.planes import sharpened, turned_towards
from topokit.core.cloud.poles import normals_by_poles
from topokit.core.cloud.propagation import propagate_signs
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.core.processors import n_cores

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]
Scale = Literal["coarse", "fine"]

INTERPOLATING = 0.97
"""Coverage from which samples count as free of noise, so that a missed one is a missed feature."""

_HANDICAP = {"fine alternation": 1.0, "coarse alternation": 1.0, "fine solve": 1.05, "coarse solve": 1.05}
"""Cost factors: a candidate without alternation must be clearly better."""

_FEW_CONTRADICTED = 0.002  # share of normals against their own solid up to which propagation is believed
_SMOOTH = 0.2  # roughness up to which it is tried on all points: of 47 clean shapes 30 are below, 27 of them believed
_GRAPH = 8  # neighbors that signs are carried to
_SMALLEST_PART = 20  # samples of the smallest part that must be covered by itself
_MOSTLY_COVERED = 0.9  # coverage that it needs for that; edges of CAD parts leave 8 % of the samples off the surface
_HIDDEN = 0.5  # coverage by all candidates of one grid below which another grid shows no surface either
_HOPELESS = 2.0  # cost ratio from which a candidate is not corrected
_COVERAGE_POWER = 9.0  # how much a missed sample costs then
_LEAST_COVERAGE = 1e-3  # keeps the cost finite
_COARSE_CELLS, _COARSE_ITERATIONS = 64, 20  # cells along the longest side; conjugate-gradient steps
_FINE_CELLS, _FINE_ITERATIONS = 160, 12
_ALTERNATIONS, _FIRST_SIGMA, _LAST_SIGMA = 8, 1.0, 0.7  # rounds; Gaussian in cells
_CHECK_VERTICES, _CHECK_SIGMA = 96**3, 2.0  # grid and Gaussian (cells) of the field that checks given normals
_CONSISTENT, _LARGEST_RESIDUAL = 0.95, 0.08  # share of normals along −∇w and mean |w(p) − ½| of consistent normals
_CHEAPER = 0.9  # cost ratio from which a found solid contradicts the given normals
_FEW = 0.03  # share of disagreeing normals up to which the given ones count as consistent


@dataclass(frozen=True, eq=False)
class Orientation:
    """Outward normals and how they were chosen.

    Attributes:
        normals: (N, 3), unit, outward: out of the solid, so into the cavity on a cavity's wall.
        candidate: the one of least cost.
        costs: of each candidate.
        coverage: share of the samples on the implied solid's surface.
        complex_: the tetrahedra of the samples, for further use.
        cut: with these normals and the weights by default, if it was made.
        trials: normals of every candidate, with the cut that they imply.
    """

    normals: Floats
    candidate: str
    costs: dict[str, float]
    coverage: float
    complex_: DelaunayComplex
    cut: Cut | None = None
    trials: tuple[tuple[Floats, Cut], ...] = ()

    def corrected(self, axes: Floats | None = None) -> tuple[Floats, Cut]:
        """Outward normals of the candidate that implies the cheapest solid once the poles have corrected its signs.

        With them comes the cut that they imply.

        Args:
            axes: (N, 3), unit normals of arbitrary sign, where known.
        """
        hopeless = _HOPELESS * min(_cost(cut, _COVERAGE_POWER) for _, cut in self.trials)
        found = [
            normals_by_poles(self.complex_, normals, cut, rounds=2, axes=axes)
            for normals, cut in self.trials
            if _cost(cut, _COVERAGE_POWER) <= hopeless
        ]
        return min(found, key=lambda trial: _cost(trial[1], _COVERAGE_POWER))


def orient_samples(points: Floats, local: LocalGeometry) -> Orientation:
    """Outward normals for unoriented samples.

    Args:
        points: (N, 3), centered, of moderate extent and number.
        local: neighborhoods of the points.
    """
    complex_ = delaunay_complex(points, local.spacings)
    propagated = _propagated(points, local, complex_)
    if propagated is not None:
        return propagated
    directions = candidate_directions(points, local)
    cleaned = [_cleaned(points, direction, local) for direction in directions.values()]
    with ThreadPoolExecutor(n_cores()) as threads:
        cuts = list(threads.map(partial(cut_complex, complex_), cleaned))
    trials = {
        name: (direction, normals, cut)
        for (name, direction), normals, cut in zip(directions.items(), cleaned, cuts, strict=True)
    }
    is_clean = max(cut.coverage for _, _, cut in trials.values()) >= INTERPOLATING
    power = _COVERAGE_POWER if is_clean else 1.0
    costs = {name: _HANDICAP[name] * _cost(cut, power) for name, (_, _, cut) in trials.items()}
    best = min(costs, key=lambda candidate: costs[candidate])
    direction, normals, _ = trials[best]
    normals = _cleaned(points, unit(normals + direction), local)
    cut = cut_complex(complex_, normals)
    surface, _ = surface_normals(complex_, cut.inside, normals)
    normals = unit(surface + normals + 1e-9 * direction)  # the last term decides where the others cancel
    kept = tuple((candidate, its_cut) for _, candidate, its_cut in trials.values())
    return Orientation(normals, best, costs, cut.coverage, complex_, trials=kept)


def _cleaned(points: Floats, normals: Floats, local: LocalGeometry) -> Floats:
    """Normals (N, 3) of planes through neighbors whose normals agree, near creases of the planes of single faces."""
    normals = clean_normals(points, normals, local.index)
    return sharpened(normals, local.faces)


def _propagated(points: Floats, local: LocalGeometry, complex_: DelaunayComplex) -> Orientation | None:
    """Normals with signs carried along the surface, if the samples are smooth and the solid that they imply agrees."""
    if local.roughness > _SMOOTH:
        return None
    axes = sharpened(local.normals, local.faces)
    neighbors = local.index[:, 1 : _GRAPH + 1].astype(np.int32)
    found = propagate_signs(points, axes, local.areas, neighbors, by_vote=local.faces is not None)
    normals = _cleaned(points, found.normals, local)
    cut = cut_complex(complex_, normals)
    surface, is_on = surface_normals(complex_, cut.inside, normals)
    if not _is_believed(surface, is_on, normals, found.parts, INTERPOLATING):
        return None
    outward = unit(surface + normals + 1e-9 * found.normals)  # the last term decides where the others cancel
    return Orientation(
        outward, "propagation", {"propagation": _cost(cut)}, cut.coverage, complex_, None, ((normals, cut),)
    )


def _is_believed(surface: Floats, is_on: Booleans, normals: Floats, parts: Integers, least_coverage: float) -> bool:
    """Whether a solid contradicts few of the normals (N, 3) and no part of the cloud is off its surface.

    A cavity whose normals point out of it rather than into it is left out by the cut: however small, its part tells.
    """
    contradicted = float(((surface * normals).sum(1) < 0).mean())
    size = np.bincount(parts)
    covered = np.bincount(parts, is_on)[size >= _SMALLEST_PART] / size[size >= _SMALLEST_PART]
    whole = float(is_on.mean())
    return contradicted <= _FEW_CONTRADICTED and min((whole, *covered)) >= least_coverage


def orient_by_patches(
    points: Floats, normals: Floats, patches: Integers, parts: Integers, local: LocalGeometry
) -> Orientation:
    """Outward normals for samples whose normals are known up to the signs of whole patches.

    The normals are believed where the solid that they imply contradicts few of them. Otherwise they compete with the
    fields' directions, taken patch by patch and one by one.

    Args:
        points: (N, 3), centered, of moderate extent and number.
        normals: (N, 3), unit, outward if nothing went wrong on the way along the surface.
        patches: (N,), numbers 0, 1, … of pieces within which the signs agree.
        parts: (N,), numbers of the connected parts of the cloud.
        local: neighborhoods of the points.
    """
    complex_ = delaunay_complex(points, local.spacings)
    cut = cut_complex(complex_, normals)
    surface, is_on = surface_normals(complex_, cut.inside, normals)
    if _is_believed(surface, is_on, normals, parts, _MOSTLY_COVERED):
        return Orientation(
            normals, "propagation", {"propagation": _cost(cut)}, cut.coverage, complex_, cut, ((normals, cut),)
        )
    candidates, cuts = {"propagation": normals}, {"propagation": cut}
    for scale in ("coarse", "fine"):
        for name, candidate in _resigned(points, normals, patches, local, scale).items():
            if not any(np.array_equal(candidate, other) for other in candidates.values()):
                candidates[name], cuts[name] = candidate, cut_complex(complex_, candidate)
        if max(one.coverage for one in cuts.values()) < _HIDDEN:
            break
    is_clean = max(one.coverage for one in cuts.values()) >= INTERPOLATING
    costs = {name: _cost(one, _COVERAGE_POWER if is_clean else 1.0) for name, one in cuts.items()}
    best = min(costs, key=lambda candidate: costs[candidate])
    surface, _ = surface_normals(complex_, cuts[best].inside, candidates[best])
    kept = tuple((candidates[name], one) for name, one in cuts.items())
    outward = turned_towards(candidates[best], surface)
    return Orientation(outward, best, costs, cuts[best].coverage, complex_, trials=kept)


def _resigned(
    points: Floats, normals: Floats, patches: Integers, local: LocalGeometry, scale: Scale
) -> dict[str, Floats]:
    """The normals with the signs that a field's directions give to whole patches, and to each sample."""
    found = {}
    for name, direction in candidate_directions(points, local, (scale,)).items():
        if name.endswith("solve"):
            continue  # the alternation is nearly always better, and cuts of many samples are slow
        along = (normals * direction).sum(1)
        by_patch = np.where(np.bincount(patches, local.areas * along)[patches] < 0, -1.0, 1.0)
        found[f"{name} of patches"] = normals * by_patch[:, None]
        found[f"{name} of samples"] = normals * np.where(along < 0, -1.0, 1.0)[:, None]
    return found


def _cost(cut: Cut, power: float = 1.0) -> float:
    """Cost of a solid: the energy of its cut, raised where samples are off its surface."""
    return float(cut.energy / max(cut.coverage, _LEAST_COVERAGE) ** power)


def candidate_directions(
    points: Floats, local: LocalGeometry, scales: tuple[Scale, ...] = ("coarse", "fine")
) -> dict[str, Floats]:
    """Unit outward directions (N, 3) per candidate: on each grid before and after the alternation."""
    longest = float(np.ptp(points, axis=0).max())
    fine_cells = min(1.2 * longest / local.spacing + 30, _FINE_CELLS)  # a cell a bit smaller than the spacing
    grids = {"coarse": (longest / _COARSE_CELLS, _COARSE_ITERATIONS), "fine": (longest / fine_cells, _FINE_ITERATIONS)}
    result = {}
    for name in scales:
        cell, iterations = grids[name]
        solver = DipoleSolver(points, local.areas, cell)
        solved = solver.conjugate_gradients(1.0, iterations)
        result[f"{name} solve"] = unit(solved.double().numpy())
        alternated = solver.alternate(solved, _FIRST_SIGMA, _LAST_SIGMA, _ALTERNATIONS)
        result[f"{name} alternation"] = unit(alternated.double().numpy())
    return result


def check_normals(
    points: Floats, normals: Floats, areas: Floats, local: LocalGeometry, complex_: DelaunayComplex
) -> tuple[Literal["outward", "inward", "mixed"], float]:
    """Whether given normals point outward consistently, and the share that is confirmed up to a common sign.

    The winding-number field of consistent outward normals is high inside, low at the box's faces, near one half at
    every sample, and falls along every normal. Where one of these fails, the normals are compared with an orientation
    found without them. "mixed" requires that this orientation implies a clearly cheaper solid, so that correct normals
    of thin sheets, where orientation is hard, are kept.

    Args:
        points: (N, 3), centered.
        normals: (N, 3), unit.
        areas: (N,).
        local: neighborhoods of the points.
        complex_: tetrahedra of the points.
    """
    p, n, a = (torch.as_tensor(values, dtype=torch.float32) for values in (points, normals, areas))
    grid = make_grid(p, local.spacing, 1.0, _CHECK_VERTICES, minimum_length=48)
    field = winding_field(p, n, a, grid, _CHECK_SIGMA)
    confirmed = float(((field.gradient(p) * n).sum(1) < 0).double().mean())
    residual = float((field.sample(p) - 0.5).abs().mean())
    sign = 1.0 if float(field.values.mean()) > float(border_mean(field.values)) else -1.0
    if confirmed < _CONSISTENT or residual > _LARGEST_RESIDUAL:
        agreement, is_cheaper = _compare_with_found(points, sign * normals, normals, local, complex_)
        if is_cheaper and _FEW < agreement < 1 - _FEW:
            return "mixed", max(agreement, 1 - agreement)
        if is_cheaper:
            sign = 1.0 if agreement > 0.5 else -1.0
    return ("outward" if sign > 0 else "inward"), confirmed


def compare_normals(given: Floats, found: Orientation) -> tuple[Literal["outward", "inward", "mixed"], float]:
    """Whether given normals agree with found ones, and the share that does, up to a common sign.

    Args:
        given: (N, 3), unit.
        found: an orientation of the same samples, which must imply a clearly cheaper solid to refute the given ones.
    """
    agreement = float(((found.normals * given).sum(1) > 0).mean())
    sign = 1.0 if agreement > 0.5 else -1.0
    confirmed = max(agreement, 1 - agreement)
    if confirmed < 1 - _FEW:
        cost = _cost(cut_complex(found.complex_, sign * given))
        if _cost(cut_complex(found.complex_, found.normals)) < _CHEAPER * cost:
            return "mixed", confirmed
    return ("outward" if sign > 0 else "inward"), confirmed


def _compare_with_found(
    points: Floats, outward: Floats, normals: Floats, local: LocalGeometry, complex_: DelaunayComplex
) -> tuple[float, bool]:
    """Share of given normals that agree with found ones, and whether those imply a clearly cheaper solid."""
    direction = candidate_directions(points, local, ("coarse",))["coarse alternation"]
    agreement = float(((direction * normals).sum(1) > 0).mean())
    found = cut_complex(complex_, _cleaned(points, direction, local))
    return agreement, _cost(found) < _CHEAPER * _cost(cut_complex(complex_, outward))
