"""Shape: what every adapter returns, and what a user asks."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal

import torch
from torch import Tensor

from topokit.core.boundary import boundary_points, looks_closed
from topokit.core.components import SurfaceComponent
from topokit.core.curvature import DEFAULT_NEIGHBORS, Curvature, surface_curvature
from topokit.core.field import Field
from topokit.core.gauss_bonnet import euler_by_component, euler_characteristic
from topokit.core.neighbors import neighbor_components
from topokit.core.samples import SurfaceSamples
from topokit.core.voronoi import AreaMethod
from topokit.core.weingarten import Solver
from topokit.errors import GenusError, InputError
from topokit.report import Evidence, ExactAnswer, TopologyReport, betti_numbers, count_cavities, sum_genus

EulerMethod = Literal["gauss-bonnet", "field"]


class Shape:
    """A surface as samples, with the exact answer where the representation carries one.

    Attributes:
        samples: points with normals, frames and areas as far as known.
        exact: combinatorial answer, or None.
        field: the scalar field that the shape is given by, on its own grid, or None.
        mesh: (vertices (V, 3), faces (F, 3)) where the shape was made from a mesh, or None.
        name: what to call it in reports.
        notes: sentences about what was found or changed while opening it; they become reasons in the report.
        n_neighbors: k of the local half.
    """

    def __init__(
        self,
        samples: SurfaceSamples | Callable[[], SurfaceSamples],
        exact: ExactAnswer | Callable[[], ExactAnswer] | None = None,
        *,
        field: Field | None = None,
        mesh: tuple[Tensor, Tensor] | None = None,
        name: str = "shape",
        notes: tuple[str, ...] = (),
        n_neighbors: int = DEFAULT_NEIGHBORS,
    ) -> None:
        self.field = field
        self.mesh = mesh
        self.name = name
        self.notes = notes
        self.n_neighbors = n_neighbors
        self._exact = exact
        self._samples = samples if callable(samples) else self._checked(samples)

    @property
    def samples(self) -> SurfaceSamples:
        """The samples; where making them is work, this is done when they are first asked for."""
        if callable(self._samples):
            self._samples = self._checked(self._samples())
        return self._samples

    @property
    def exact(self) -> ExactAnswer | None:
        """The combinatorial answer, found when it is first asked for, or None."""
        if callable(self._exact):
            self._exact = self._exact()
        return self._exact

    def _checked(self, samples: SurfaceSamples) -> SurfaceSamples:
        if not isinstance(samples, SurfaceSamples):
            raise InputError(f"samples must be a SurfaceSamples, got {type(samples).__name__}.")
        if samples.n_points <= self.n_neighbors:
            raise InputError(
                f"{self.name} has {samples.n_points} points, too few for {self.n_neighbors} neighbours each: "
                f"give at least {self.n_neighbors + 1}, or pass n_neighbors={max(3, samples.n_points - 1)} or fewer "
                "(at least 3)."
            )
        return samples

    def __repr__(self) -> str:
        known = "exact, " if self._exact else ""
        count = "no samples yet" if callable(self._samples) else f"{tuple(self._samples.points.shape)} samples"
        return f"Shape({self.name!r}, {known}{count})"

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

    def euler(
        self,
        n_neighbors: int | None = None,
        *,
        solver: Solver = "sylvester",
        method: EulerMethod = "gauss-bonnet",
        tau: float | None = None,
    ) -> Tensor:
        """Differentiable Euler characteristic: χ⁽⁰⁾ = (1/2π) Σ K·A of the samples, or χ_τ of the shape's field.

        It is a real number near the integer; `report()` gives the integer and says how far to believe it.

        Args:
            n_neighbors: k for "gauss-bonnet"; the shape's own by default.
            solver: for "gauss-bonnet", see `curvature`.
            method: "gauss-bonnet", or "field": χ averaged over levels within about `tau` of the field's own, on its own
                grid and in its connectivity. Only this one has a gradient that moves the topology.
            tau: for "field", in units of the field; by default its typical change over one cell. 0 gives the exact
                integer of the grid, without a gradient.

        Returns:
            0-d tensor (or (...,) for batched samples), differentiable with respect to whatever the shape was made from.

        Raises:
            InputError: for an unknown method, or "field" for a shape without a field.

        Reference:
            Paper, equation `euler`.
        """
        if method == "field":
            return self._field().euler(tau)
        if method != "gauss-bonnet":
            raise InputError(f"method {method!r} is not known; use 'gauss-bonnet' or 'field'.")
        if tau is not None:
            raise InputError(f"tau={tau} has no meaning for method='gauss-bonnet'; pass method='field' with it.")
        local = self.curvature(n_neighbors, solver=solver)
        return euler_characteristic(local.gaussian, local.area)

    def _field(self) -> Field:
        if self.field is None:
            raise InputError(f"{self.name} has no field, so method='field' cannot be used: use 'gauss-bonnet'.")
        return self.field

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
            evidence=(exact.evidence, *exact.further, curvature),
            estimate=curvature.value,
            refined=None,
            resolution=exact.resolution,
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
