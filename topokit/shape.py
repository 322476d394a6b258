"""Shape: what every adapter returns, and what a user asks."""

from __future__ import annotations

import time

import numpy as np
import torch
from torch import Tensor

from topokit.core.boundary import BoundaryCurve, boundary_curves, euler_of_boundary, rim_points
from topokit.core.curvature import DEFAULT_NEIGHBORS, Curvature, surface_curvature
from topokit.core.enclosed_solid import enclosed_solid
from topokit.core.gauss_bonnet import euler_characteristic
from topokit.core.refine import corrected, self_optimize
from topokit.core.samples import SurfaceSamples
from topokit.core.voronoi import AreaMethod
from topokit.core.weingarten import Solver
from topokit.core.witness import Witness, global_witness
from topokit.diagnosis import Measured, exact_report, sampled_report
from topokit.errors import GenusError, InputError
from topokit.report import Evidence, ExactAnswer, TopologyReport


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
        self._witnessed: list[Witness | InputError] | None = None

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

    def euler(
        self,
        n_neighbors: int | None = None,
        *,
        refine: bool = True,
        target: Tensor | float | None = None,
        solver: Solver = "sylvester",
        max_steps: int = 20,
    ) -> Tensor:
        """Differentiable Euler characteristic by Gauss–Bonnet: χ⁽ᴷ⁾ (Algorithm 2 whole), or χ⁽⁰⁾ with `refine=False`.

        χ⁽⁰⁾ = (1/2π) Σ K·A, with the boundary's turning added where the samples show one. χ⁽ᴷ⁾ is the same sum at
        normals that self-optimisation has turned until it meets the target. The gradient of χ⁽ᴷ⁾ is that of the sum
        at these normals with the correction held fixed; the refined value itself hardly depends on anything.
        `report()` gives the integer and says how far to believe it.

        Args:
            n_neighbors: k; the shape's own by default.
            refine: whether to self-optimise.
            target: what χ must be; by default the exact integer where there is one, else the global witness's.
                Without either (planes, lines, ...) nothing is refined.
            solver: see `topokit.core.weingarten`.
            max_steps: of the self-optimisation.

        Returns:
            0-d tensor (or (...,) for batched samples), differentiable with respect to points and normals.

        Reference:
            Paper, equation `euler` and Algorithm 2.
        """
        k = n_neighbors or self.n_neighbors
        local = surface_curvature(self.samples, k, solver=solver)
        boundary = self._boundary(local)
        goal = self._targets(target, local) if refine else None
        if goal is None:
            return euler_characteristic(local.gaussian, local.area) + boundary
        oriented = self._with_normals(local)
        refinement = self_optimize(
            oriented, goal - boundary, max_steps=max_steps, n_neighbors=k, solver=solver, neighbors=local.neighbors
        )
        refined = surface_curvature(corrected(oriented, refinement), k, solver=solver, neighbors=local.neighbors)
        return euler_characteristic(refined.gaussian, refined.area) + boundary

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

    def report(self, *, refine: bool | None = None) -> TopologyReport:
        """Everything there is to say: integer, genus, components, verdict, reasons and evidence.

        A shape with an exact answer (a mesh) reports that; the estimate from curvature stands beside it. Samples are
        judged by the global witness, with curvature beside it. Batched samples have no single report.

        Args:
            refine: whether to compute the self-optimised χ⁽ᴷ⁾ for the record; by default only where nothing is exact.

        Raises:
            InputError: if the samples are batched.
        """
        if self.samples.points.ndim != 2:
            raise InputError(
                f"a report is about one shape; the samples are batched, {tuple(self.samples.points.shape)}. "
                "Ask euler() for all of them, or report() item by item."
            )
        wanted = self.exact is None if refine is None else refine
        measured = self._measure(wanted)
        if self.exact is not None:
            return exact_report(self.name, self.notes, self.exact, measured)
        return sampled_report(self.name, self.notes, self.samples.points.detach(), measured)

    def oriented(self) -> Shape:
        """The same shape with outward normals found by the global witness, where its own have no signs.

        Returns:
            A `Shape` whose normals are differentiable in the points; this one if it is oriented already.

        Raises:
            InputError: if the points bound no solid, so that there is no outside.
        """
        if self.samples.oriented:
            return self
        for found in self._witnesses():
            if isinstance(found, InputError):
                raise found
        samples = self._with_normals(self.curvature())
        return Shape(
            samples, self.exact, mesh=self.mesh, name=self.name, notes=self.notes, n_neighbors=self.n_neighbors
        )

    @torch.no_grad()
    def _measure(self, refine: bool) -> Measured:
        started = time.perf_counter()
        local = self.curvature()
        curves = () if self._is_exactly_closed() else self._curves(local)[0]
        estimate = float(euler_characteristic(local.gaussian, local.area)) + euler_of_boundary(curves)
        evidence = [Evidence("Gauss–Bonnet", estimate, None, time.perf_counter() - started)]
        witness, refusal = None, ""
        if self.exact is None:
            found = self._witnesses()[0]
            witness, refusal = (None, str(found)) if isinstance(found, InputError) else (found, "")
        if witness is not None:
            evidence += _votes(witness)
        refined = None
        if refine:
            started = time.perf_counter()
            refined = float(self.euler())
            evidence.append(Evidence("Gauss–Bonnet, self-optimised", refined, None, time.perf_counter() - started))
        solid = None
        if self.exact is not None and self.mesh is not None:
            started = time.perf_counter()
            solid = enclosed_solid(*self.mesh)
            seconds = time.perf_counter() - started
            evidence.append(Evidence("solid by winding number", float(solid.euler), solid.euler, seconds))
        return Measured(local, curves, estimate, refined, witness, refusal, tuple(evidence), solid)

    def _is_exactly_closed(self) -> bool:
        return self.exact is not None and self.exact.closed

    def _curves(self, local: Curvature) -> list[tuple[BoundaryCurve, ...]]:
        """Boundary curves per batch item, from the geometry of the points alone."""
        found = []
        k = local.neighbors.shape[-1]
        for item, points in enumerate(self.samples.points.detach().reshape(-1, self.samples.n_points, 3)):
            rows = slice(item * len(points), (item + 1) * len(points))
            neighbors = local.neighbors[rows] - item * len(points)
            with torch.no_grad():
                plain = surface_curvature(SurfaceSamples(points), k, neighbors=neighbors)
            spacing = float(plain.area.mean().sqrt())
            rim = rim_points(points, plain.normals, neighbors)
            found.append(boundary_curves(points, plain.normals, rim, spacing))
        return found

    def _boundary(self, local: Curvature) -> Tensor:
        """The boundary's share of χ, (...)."""
        lead = self.samples.points.shape[:-2]
        if self._is_exactly_closed():
            return local.area.new_zeros(lead)
        shares = [euler_of_boundary(curves) for curves in self._curves(local)]
        return local.area.new_tensor(shares).reshape(lead)

    def _witnesses(self) -> list[Witness | InputError]:
        """The global witness per batch item, asked once; its refusal where the points bound no solid."""
        if self._witnessed is None:
            self._witnessed = []
            samples = self.samples
            points = samples.points.detach().reshape(-1, samples.n_points, 3)
            known = samples.known_normals()
            normals = None if known is None else known.detach().reshape(points.shape)
            for item in range(len(points)):
                try:
                    own = None if normals is None else normals[item]
                    found: Witness | InputError = global_witness(points[item], own, oriented=samples.oriented)
                except InputError as error:
                    found = error
                self._witnessed.append(found)
        return self._witnessed

    def _targets(self, target: Tensor | float | None, local: Curvature) -> Tensor | None:
        """What χ is to become, (...), or None if there is nothing to go by."""
        lead = self.samples.points.shape[:-2]
        if target is not None:
            return torch.as_tensor(target).to(local.area).expand(lead)
        if self.exact is not None and self.exact.evidence.integer is not None:
            return local.area.new_tensor(self.exact.evidence.integer)
        found = self._witnesses()
        if any(isinstance(one, InputError) for one in found):
            return None
        return local.area.new_tensor([one.euler for one in found if isinstance(one, Witness)]).reshape(lead)

    def _with_normals(self, local: Curvature) -> SurfaceSamples:
        """Samples with normals, those of PCA turned outward where the witness knows the outside."""
        samples, normals = self.samples, local.normals
        if samples.oriented:
            return SurfaceSamples(samples.points, normals, areas=samples.areas)
        found = self._witnesses()
        if any(isinstance(one, InputError) for one in found):
            return SurfaceSamples(samples.points, normals, areas=samples.areas, oriented=False)
        outward = np.stack([one.normals for one in found if isinstance(one, Witness)])
        reference = torch.from_numpy(outward).to(normals).reshape(normals.shape)
        sign = torch.where((normals.detach() * reference).sum(-1, keepdim=True) < 0, -1.0, 1.0).to(normals)
        return SurfaceSamples(samples.points, sign * normals, areas=samples.areas)


def _votes(witness: Witness) -> list[Evidence]:
    """The two families of the global witness, each with the value it gives most often."""
    rows = []
    for name, key, stage in (("Delaunay cuts", "cut", "votes"), ("winding-number fields", "grid", "votes")):
        values = [value for setting, value in witness.votes.items() if key in setting]
        most = max(values, key=lambda value: (values.count(value), -abs(value)))
        rows.append(
            Evidence(
                name, float(sum(values) / len(values)), most, witness.seconds[stage] * len(values) / len(witness.votes)
            )
        )
    return rows
