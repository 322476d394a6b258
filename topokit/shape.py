"""Shape: what every adapter returns, and what a user asks."""

from __future__ import annotations

import time

import torch
from torch import Tensor

from topokit.core.boundary import boundary_points, looks_closed
from topokit.core.components import SurfaceComponent
from topokit.core.curvature import DEFAULT_NEIGHBORS, Curvature, surface_curvature
from topokit.core.gauss_bonnet import euler_by_component, euler_characteristic
from topokit.core.neighbors import neighbor_components
from topokit.core.samples import SurfaceSamples
from topokit.core.voronoi import AreaMethod
from topokit.core.weingarten import Solver
from topokit.errors import GenusError, InputError
from topokit.report import Evidence, ExactAnswer, TopologyReport, betti_numbers, count_cavities, sum_genus


class Shape:
    """A surface as samples, with the exact answer where the representation carries one.

    Attributes:
        samples: points with normals, frames and areas as far as known.
        exact: combinatorial answer, or None.
        mesh: (vertices (V, 3), faces (F, 3)) where the shape was made from a mesh, or None.
        name: what to call it in reports.
        notes: sentences about what was found or changed while opening it; they become reasons in the report.
        n_neighbors: k of the local half.
    """

    def __init__(
        self,
        samples: SurfaceSamples,
        exact: ExactAnswer | None = None,
        *,
        mesh: tuple[Tensor, Tensor] | None = None,
        name: str = "shape",
        notes: tuple[str, ...] = (),
        n_neighbors: int = DEFAULT_NEIGHBORS,
    ) -> None:
        if not isinstance(samples, SurfaceSamples):
            raise InputError(f"samples must be a SurfaceSamples, got {type(samples).__name__}.")
        if samples.n_points <= n_neighbors:
            raise InputError(
                f"{name} has {samples.n_points} points, too few for {n_neighbors} neighbours each: "
                f"give at least {n_neighbors + 1}, or pass a smaller n_neighbors (3 or more)."
            )
        self.samples = samples
        self.exact = exact
        self.mesh = mesh
        self.name = name
        self.notes = notes
        self.n_neighbors = n_neighbors

    def __repr__(self) -> str:
        known = "exact, " if self.exact else ""
        return f"Shape({self.name!r}, {known}{tuple(self.samples.points.shape)} samples)"

    def curvature(
        self,
        n_neighbors: int | None = None,
        *,
        solver: Solver = "sylvester",
        area_method: AreaMethod = "exact",
        area_resolution: int = 32,
    ) -> Curvature:
        """Gaussian, mean, total and principal curvature, directions and area at every sample.

        Args:
            n_neighbors: k; the shape's own by default.
            solver: "sylvester", "symmetrized" or "commuting" (see `topokit.core.weingarten`).
            area_method: "exact" or "monte-carlo".
            area_resolution: side of the Monte Carlo grid.

        Returns:
            `Curvature`, differentiable with respect to whatever the shape was made from. H is positive where the
            surface bends towards its inside; without oriented normals its sign means nothing.
        """
        return surface_curvature(
            self.samples,
            n_neighbors or self.n_neighbors,
            solver=solver,
            area_method=area_method,
            area_resolution=area_resolution,
        )

    def euler(self, n_neighbors: int | None = None, *, solver: Solver = "sylvester") -> Tensor:
        """Differentiable Euler characteristic χ⁽⁰⁾ = (1/2π) Σ K·A of the samples.

        It is a real number near the integer; `report()` gives the integer and says how far to believe it.

        Returns:
            0-d tensor (or (...,) for batched samples), differentiable with respect to points and normals.

        Reference:
            Paper, equation `euler`.
        """
        local = self.curvature(n_neighbors, solver=solver)
        return euler_characteristic(local.gaussian, local.area)

    def genus(self) -> int:
        """Handles summed over components, from the report's integer.

        Raises:
            GenusError: if the surface is open, not a manifold or not orientable, or its genus is not known.
        """
        report = self.report()
        if report.genus is None:
            why = " ".join(report.reasons) or "Nothing is known about it."
            raise GenusError(f"{self.name} has no genus that topokit can vouch for. {why}")
        return report.genus

    def report(self) -> TopologyReport:
        """Everything there is to say: integer, genus, components, verdict, reasons and evidence.

        Meshes answer from their connectivity; the estimate from curvature stands beside it. Batched samples have no
        single report.

        Raises:
            InputError: if the samples are batched.
        """
        if self.samples.points.ndim != 2:
            raise InputError(
                f"a report is about one shape; the samples are batched, {tuple(self.samples.points.shape)}. "
                "Ask euler() for all of them, or report() item by item."
            )
        started = time.perf_counter()
        with torch.no_grad():
            local = self.curvature()
            estimate = float(euler_characteristic(local.gaussian, local.area))
        evidence = Evidence("Gauss–Bonnet", estimate, None, time.perf_counter() - started)
        if self.exact is not None:
            return self._report_exact(self.exact, evidence)
        return self._report_sampled(local, evidence)

    def _report_exact(self, exact: ExactAnswer, curvature: Evidence) -> TopologyReport:
        closed, components = exact.closed, exact.components
        return TopologyReport(
            name=self.name,
            euler=exact.evidence.integer,
            genus=sum_genus(components),
            components=len(components),
            cavities=count_cavities(components) if closed else None,
            betti=betti_numbers(components, closed),
            boundary_loops=exact.boundary_loops,
            closed=closed,
            verdict=exact.verdict,
            reasons=self.notes + exact.reasons,
            evidence=(exact.evidence, curvature),
            estimate=curvature.value,
            refined=None,
            resolution=None,
            per_component=components,
        )

    def _report_sampled(self, local: Curvature, curvature: Evidence) -> TopologyReport:
        is_boundary = boundary_points(local.is_boundary, local.neighbors)
        closed = looks_closed(is_boundary)
        integer = 2 * round(curvature.value / 2) if closed else round(curvature.value)
        spacing = float((local.area.sum() / local.area.numel()).sqrt())
        components = self._sampled_components(local)
        reasons = [
            f"Gauss–Bonnet on {self.samples.n_points} samples gives {curvature.value:.2f}; the nearest "
            f"{'even ' if closed else ''}integer is {integer}.",
            "It is the only witness there is for samples, so it stays unsure.",
            f"Features smaller than about {3 * spacing:.3g} (three sample spacings) cannot be seen.",
        ]
        if not closed:
            low, high = (corner.tolist() for corner in self.samples.points[is_boundary].detach().aminmax(dim=0))
            reasons.append(
                f"The surface is not closed: {int(is_boundary.sum())} samples lie on its boundary, between "
                f"({_numbers(low)}) and ({_numbers(high)}); the boundary's own share of χ is not included."
            )
        return TopologyReport(
            name=self.name,
            euler=integer,
            genus=(2 * len(components) - integer) // 2 if closed and integer <= 2 * len(components) else None,
            components=len(components),
            cavities=None,
            betti=None,
            boundary_loops=None,
            closed=closed,
            verdict="unsure",
            reasons=self.notes + tuple(reasons),
            evidence=(Evidence(curvature.name, curvature.value, integer, curvature.seconds),),
            estimate=curvature.value,
            refined=None,
            resolution=3 * spacing,
            per_component=components,
        )

    def _sampled_components(self, local: Curvature) -> tuple[SurfaceComponent, ...]:
        labels = neighbor_components(local.neighbors)
        estimates = euler_by_component(local.gaussian, local.area, labels)
        areas = torch.zeros_like(estimates).index_add(0, labels, local.area)
        shares = (areas / areas.sum().clamp(min=torch.finfo(areas.dtype).tiny)).tolist()
        points = self.samples.points.detach()
        rows = labels[:, None].expand_as(points)
        corners = points.new_zeros(len(estimates), 3)
        low = corners.scatter_reduce(0, rows, points, "amin", include_self=False).tolist()
        high = corners.scatter_reduce(0, rows, points, "amax", include_self=False).tolist()
        found = [
            SurfaceComponent(None, None, None, (tuple(low[i]), tuple(high[i])), shares[i], estimate=estimate)
            for i, estimate in enumerate(estimates.tolist())
        ]
        return tuple(sorted(found, key=lambda component: -component.area_share))


def _numbers(values: list[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
