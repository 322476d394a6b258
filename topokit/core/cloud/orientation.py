"""Outward normals for unoriented samples, and a check of given normals.

The winding number of a closed surface is one half on the surface. Regularized conjugate gradients solve w(pᵢ) = ½ for
the dipole vectors, in the Fourier operator of `winding_field` and without normals. An alternation sharpens the result:
one steepest-descent step, then every dipole is aligned with −∇w. Both run on a coarse grid (robust to noise) and on one
that follows the sample spacing (right on thin sheets). The candidates are smoothed over neighbors that agree and are
compared by the cost of the best solid that they imply (`delaunay_cut`).

References:
    S. Lin, Z. Shi, Y. Liu, "Fast and globally consistent normal orientation based on the winding number normal
    consistency", ACM TOG 43(6), 2024, doi:10.1145/3687895.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from topokit.core.cloud.delaunay_cut import DelaunayComplex, cut_complex, delaunay_complex, surface_normals
from topokit.core.cloud.downsampling import spread_signs, thin
from topokit.core.cloud.neighborhoods import (
    LocalGeometry,
    centered_positions,
    clean_normals,
    disagreement,
    local_geometry,
    unit,
)
from topokit.core.grid.grid import make_grid
from topokit.core.grid.splines import GridSampler
from topokit.core.grid.winding_field import PoissonFilter, winding_field

Floats = NDArray[np.float64]

_HANDICAP = {"fine alternation": 1.0, "coarse alternation": 1.0, "fine solve": 1.05, "coarse solve": 1.05}
"""Cost factors: a candidate without the alternation must be clearly better to win."""

_INTERPOLATING = 0.97
"""Share of samples on a solid's surface above which the samples count as free of noise: a sample that the surface
misses is then a feature that it misses."""


@dataclass(frozen=True, eq=False)
class Orientation:
    """Outward normals and how they were chosen.

    Attributes:
        normals: (N, 3), unit, pointing out of the solid, so into the cavity on the wall of a cavity.
        candidate: name of the candidate with the lowest cost.
        costs: of each candidate.
        disagreement: share of neighbor pairs whose normals oppose each other.
        coverage: share of the samples on the implied solid's surface.
        complex_: Delaunay tetrahedra of the oriented samples, for further use.
    """

    normals: Floats
    candidate: str
    costs: dict[str, float]
    disagreement: float
    coverage: float
    complex_: DelaunayComplex


def orient(points: ArrayLike, areas: ArrayLike | None = None) -> Orientation:
    """Outward normals for unoriented samples.

    Of more than 30 000 points, about 20 000 that are evenly spread are oriented; every other point takes the normal of
    its own local plane with the sign of the nearest of those. Points in the same place count once.

    Args:
        points: (N, 3), on the CPU.
        areas: (N,), surface area that each sample stands for; estimated from the neighbors by default.

    Raises:
        InputError: for fewer than 32 points, points that are not finite, in a plane, on a line or in one place.
    """
    positions, unit_length = centered_positions(np.asarray(points, dtype=np.float64))
    scaled = None if areas is None else np.asarray(areas, dtype=np.float64) / unit_length**2
    kept, kept_areas = thin(positions, scaled)
    chosen = positions[kept]
    found = orient_samples(chosen, local_geometry(chosen, areas=kept_areas))
    if len(kept) == len(positions):
        return found
    return replace(found, normals=spread_signs(positions, kept, found.normals))


def orient_samples(points: Floats, local: LocalGeometry) -> Orientation:
    """`orient` for centered positions (N, 3), not too many, whose neighborhoods are known."""
    complex_ = delaunay_complex(points, local.spacing)
    trials = {}
    for name, direction in candidate_directions(points, local).items():
        normals = clean_normals(points, direction, local.index)
        trials[name] = (direction, normals, cut_complex(complex_, normals))
    power = 9.0 if max(cut.coverage for _, _, cut in trials.values()) >= _INTERPOLATING else 1.0
    costs = {
        name: _HANDICAP[name] * cut.energy / max(cut.coverage, 1e-3) ** power for name, (_, _, cut) in trials.items()
    }
    name = min(costs, key=lambda candidate: costs[candidate])
    direction, normals, _ = trials[name]
    normals = clean_normals(points, unit(normals + direction), local.index)
    cut = cut_complex(complex_, normals)
    surface, _ = surface_normals(complex_, cut.inside, normals)
    normals = unit(surface + normals + 1e-9 * direction)
    return Orientation(normals, name, costs, disagreement(normals, local.index), cut.coverage, complex_)


def candidate_directions(
    points: Floats, local: LocalGeometry, scales: tuple[str, ...] = ("coarse", "fine")
) -> dict[str, Floats]:
    """Unit outward directions (N, 3) of each candidate: on a coarse and a fine grid, before and after alternation."""
    longest = float(np.ptp(points, axis=0).max())
    cells = {"coarse": (longest / 64, 20), "fine": (longest / min(1.2 * longest / local.spacing + 30, 160), 12)}
    result = {}
    for name in scales:
        cell, iterations = cells[name]
        solver = _DipoleSolver(points, local.areas, cell)
        solved = solver.conjugate_gradients(1.0, iterations)
        result[name + " solve"] = unit(solved.double().numpy())
        result[name + " alternation"] = unit(solver.alternate(solved, 1.0, 0.7, 8).double().numpy())
    return result


def check_normals(
    points: Floats, normals: Floats, areas: Floats, local: LocalGeometry, complex_: DelaunayComplex
) -> tuple[Literal["outward", "inward", "mixed"], float]:
    """Whether given normals point outward all together, and the share of them that is confirmed up to a common sign.

    The field of consistently outward normals is high inside, low at the box's faces, near one half at every sample, and
    falls along every normal. If one of these fails, the normals are compared with an orientation found without them.
    They count as "mixed" only if that orientation implies a clearly cheaper solid: on thin sheets, where orientations
    are hard to find, correct normals must not be rejected.

    Args:
        points: (N, 3), centered.
        normals: (N, 3), unit.
        areas: (N,).
        local: neighborhoods of the points.
        complex_: tetrahedra of the points.
    """
    p, n, a = (torch.as_tensor(values, dtype=torch.float32) for values in (points, normals, areas))
    field = winding_field(p, n, a, make_grid(p, local.spacing, 1.0, 96**3, minimum_length=48), 2.0)
    confirmed = float(((field.gradient(p) * n).sum(1) < 0).double().mean())
    residual = float((field.sample(p) - 0.5).abs().mean())
    sign = 1.0 if float(field.values.mean()) > float(_rim(field.values)) else -1.0
    if confirmed < 0.95 or residual > 0.08:
        direction = candidate_directions(points, local, ("coarse",))["coarse alternation"]
        agree = float(((direction * normals).sum(1) > 0).mean())
        found = cut_complex(complex_, clean_normals(points, direction, local.index))
        given = cut_complex(complex_, sign * normals)
        is_cheaper = found.energy / max(found.coverage, 1e-3) < 0.9 * given.energy / max(given.coverage, 1e-3)
        if 0.03 < agree < 0.97 and is_cheaper:
            return "mixed", max(agree, 1 - agree)
        if is_cheaper:
            sign = 1.0 if agree > 0.5 else -1.0
    return ("outward" if sign > 0 else "inward"), confirmed


def _rim(field: Tensor) -> Tensor:
    """Mean of a field over the faces of its box."""
    faces = [field.select(axis, end).mean() for axis in range(3) for end in (0, -1)]
    return torch.stack(faces).sum() / 6


class _DipoleSolver:
    """The linear map from dipole vectors to winding numbers at the samples, on one grid, and two ways to invert it."""

    def __init__(self, points: Floats, areas: Floats, cell: float) -> None:
        """Args: points (N, 3); areas (N,); cell: edge length of the grid's cells, unless that makes too many."""
        self.points = torch.as_tensor(points, dtype=torch.float32)
        areas_ = torch.as_tensor(areas, dtype=torch.float32)
        self.areas = areas_ / areas_.mean()
        self.grid = make_grid(self.points, cell, 1.0, 160**3, minimum_length=16)
        self.sampler = GridSampler(self.points, self.grid)
        self.solve = PoissonFilter(self.grid, 1.0, self.points)

    def field(self, dipoles: Tensor) -> Tensor:
        """Winding numbers on the grid, with mean zero over the box's faces."""
        field = -self.solve(self.sampler.splat_dipoles(dipoles))
        return field - _rim(field)

    def adjoint(self, values: Tensor) -> Tensor:
        """The adjoint map, from values at the samples (N,) to dipole vectors (N, 3)."""
        return -self.sampler.gather_gradient(self.solve(self.sampler.splat(values)))

    def conjugate_gradients(self, sigma: float, iterations: int, damping: float = 1e-2) -> Tensor:
        """Dipoles (N, 3) of least area-weighted norm for which w(pᵢ) is near one half."""
        self.solve.smooth(sigma)
        root = self.areas.sqrt()[:, None]
        solution = torch.zeros_like(self.points)
        residual = root * self.adjoint(torch.full((len(self.points),), 0.5))
        direction, size, scale = residual.clone(), (residual * residual).sum(), None
        for _ in range(iterations):
            image = root * self.adjoint(self.sampler.gather(self.field(root * direction)))
            if scale is None:
                scale = damping * (direction * image).sum() / size.clamp_min(1e-30)
            image = image + scale * direction
            length = size / (direction * image).sum().clamp_min(1e-30)
            solution, residual = solution + length * direction, residual - length * image
            new = (residual * residual).sum()
            direction, size = residual + new / size.clamp_min(1e-30) * direction, new
        return root * solution

    def alternate(self, dipoles: Tensor, first_sigma: float, last_sigma: float, iterations: int) -> Tensor:
        """Alternate a steepest-descent step on |w(p) − ½|² with the alignment of every dipole with −∇w."""
        for step in range(iterations):
            self.solve.smooth(first_sigma * (last_sigma / first_sigma) ** (step / max(iterations - 1, 1)))
            field = self.field(dipoles)
            residual = 0.5 - self.sampler.gather(field)
            descent = self.adjoint(residual) * self.areas[:, None]
            change = self.field(descent)
            image = self.sampler.gather(change)
            length = (residual * image).sum() / (image * image).sum().clamp_min(1e-30)
            dipoles, field = dipoles + length * descent, field + length * change
            outward = -self.sampler.gather_gradient(field)
            aligned = outward / outward.norm(dim=1, keepdim=True).clamp_min(1e-12)
            dipoles = dipoles.norm(dim=1, keepdim=True) * aligned
        return dipoles
