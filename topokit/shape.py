"""Shape: what every adapter returns, and what a user asks."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from typing import Literal

import torch
from torch import Tensor

from topokit.core.cloud.witness import Witness
from topokit.core.grid.field import Field, euler_of_field
from topokit.core.local.boundary import BoundaryEstimate, estimate_boundary
from topokit.core.local.curvature import DEFAULT_NEIGHBORS, Curvature, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.local.self_optimization import corrected, self_optimize
from topokit.core.local.voronoi import AreaMethod
from topokit.core.local.weingarten import Solver
from topokit.core.mesh.enclosed_solid import enclosed_solid
from topokit.core.samples import SurfaceSamples, enough_samples
from topokit.errors import InputError
from topokit.report.report import CountedAnswer, Evidence, TopologyReport, known_genus
from topokit.report.sampled import Measured, exact_report, sampled_report
from topokit.report.witnesses import Answer, ask_witnesses, is_sheet, outward_samples, vote_evidence

EulerMethod = Literal["gauss-bonnet", "field"]
UNNAMED = "shape"


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
        exact: CountedAnswer | Callable[[], CountedAnswer] | None = None,
        *,
        field: Field | None = None,
        mesh: tuple[Tensor, Tensor] | None = None,
        name: str = UNNAMED,
        notes: tuple[str, ...] = (),
        n_neighbors: int = DEFAULT_NEIGHBORS,
    ) -> None:
        self.field = field
        self.mesh = mesh
        self.name = name
        self.notes = notes
        self.n_neighbors = n_neighbors
        self._exact = exact
        self._samples = samples if callable(samples) else enough_samples(samples, n_neighbors, name)
        self._witnessed: list[Answer] | None = None
        self._ends_found: list[BoundaryEstimate] | None = None

    @property
    def samples(self) -> SurfaceSamples:
        """The samples; where making them is work, this is done when they are first asked for."""
        if callable(self._samples):
            self._samples = enough_samples(self._samples(), self.n_neighbors, self.name)
        return self._samples

    @property
    def exact(self) -> CountedAnswer | None:
        """The combinatorial answer, found when it is first asked for, or None."""
        if callable(self._exact):
            self._exact = self._exact()
        return self._exact

    def replace(self, *, name: str | None = None, n_neighbors: int | None = None) -> Shape:
        """The same shape under another name, or with another number of neighbors."""
        other = copy.copy(self)
        other.name = self.name if name is None else name
        other.n_neighbors = self.n_neighbors if n_neighbors is None else n_neighbors
        return other

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
            solver: "sylvester", "symmetrized" or "commuting" (see `topokit.core.local.weingarten`).
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
        method: EulerMethod = "gauss-bonnet",
        tau: float | None = None,
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
                Without either (planes, lines, open sheets) nothing is refined.
            solver: see `topokit.core.local.weingarten`.
            max_steps: of the self-optimisation.
            method: "gauss-bonnet", or "field": χ averaged over levels within about `tau` of the field's own, on its own
                grid and in its connectivity. Only this one has a gradient that moves the topology; the arguments
                above mean nothing to it.
            tau: for "field", in units of the field; by default its typical change over one cell. 0 gives the exact
                integer of the grid, without a gradient.

        Returns:
            0-d tensor (or (...,) for batched samples), differentiable with respect to whatever the shape was made from.

        Raises:
            InputError: for an unknown method, or "field" for a shape without a field.

        Reference:
            Paper, equation `euler` and Algorithm 2.
        """
        if method == "field":
            return euler_of_field(self.field, tau, self.name)
        if method != "gauss-bonnet" or tau is not None:
            raise InputError(f"method={method!r} with tau={tau}: use 'gauss-bonnet' without tau, or 'field'.")
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
        return known_genus(self.report())

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
        local = self.curvature()
        for found in self._witnesses(local):
            if isinstance(found, InputError):
                raise found
        samples = self._with_normals(local)
        return Shape(
            samples,
            self._exact,
            field=self.field,
            mesh=self.mesh,
            name=self.name,
            notes=self.notes,
            n_neighbors=self.n_neighbors,
        )

    @torch.no_grad()
    def _measure(self, refine: bool) -> Measured:
        started = time.perf_counter()
        local = self.curvature()
        ends = self._ends(local)[0]
        estimate = float(euler_characteristic(local.gaussian, local.area)) + ends.euler
        evidence = [Evidence("Gauss–Bonnet", estimate, None, time.perf_counter() - started)]
        witness, refusal = None, ""
        if self.exact is None:
            found = self._witnesses(local)[0]
            witness, refusal = (None, str(found)) if isinstance(found, InputError) else (found, "")
        if witness is not None:
            evidence += vote_evidence(witness)
        refined = None
        if refine and not ends.curves:
            started = time.perf_counter()
            refined = float(self.euler())
            evidence.append(Evidence("Gauss–Bonnet, self-optimised", refined, None, time.perf_counter() - started))
        solid = None
        if self.exact is not None and self.mesh is not None:
            started = time.perf_counter()
            solid = enclosed_solid(*self.mesh)
            seconds = time.perf_counter() - started
            evidence.append(Evidence("solid by winding number", float(solid.euler), solid.euler, seconds))
        return Measured(local, ends, estimate, refined, witness, refusal, tuple(evidence), solid)

    def _is_exactly_closed(self) -> bool:
        """Known without work: for a shape that is given by a field the samples are asked, not the counting."""
        return self.field is None and self.exact is not None and self.exact.closed

    def _ends(self, local: Curvature) -> list[BoundaryEstimate]:
        """Where the surface ends, per batch item, looked for once."""
        if self._ends_found is None:
            if self._is_exactly_closed():
                n_items = self.samples.points[..., 0, 0].numel()
                self._ends_found = [BoundaryEstimate((), 0.0, float(local.area.detach().mean().sqrt()))] * n_items
            else:
                n_points = self.samples.n_points
                items = self.samples.points.detach().reshape(-1, n_points, 3)
                index = local.neighbors.reshape(len(items), n_points, -1)
                self._ends_found = [
                    estimate_boundary(points, rows - item * n_points)
                    for item, (points, rows) in enumerate(zip(items, index, strict=True))
                ]
        return self._ends_found

    def _boundary(self, local: Curvature) -> Tensor:
        """The boundary's share of χ, (...)."""
        shares = [ends.euler for ends in self._ends(local)]
        return local.area.new_tensor(shares).reshape(self.samples.points.shape[:-2])

    def _witnesses(self, local: Curvature) -> list[Answer]:
        """What the global witness says, asked once."""
        if self._witnessed is None:
            self._witnessed = ask_witnesses(self.samples, self._ends(local))
        return self._witnessed

    def _targets(self, target: Tensor | float | None, local: Curvature) -> Tensor | None:
        """What χ is to become, (...), or None if there is nothing to go by."""
        lead = self.samples.points.shape[:-2]
        if target is not None:
            return torch.as_tensor(target).to(local.area).expand(lead)
        if self.exact is not None and self.exact.evidence.integer is not None:
            return local.area.new_tensor(self.exact.evidence.integer)
        found = self._witnesses(local)
        if any(ends.curves and is_sheet(ends, one) for ends, one in zip(self._ends(local), found, strict=True)):
            return None
        if any(isinstance(one, InputError) for one in found):
            return None
        return local.area.new_tensor([one.euler for one in found if isinstance(one, Witness)]).reshape(lead)

    def _with_normals(self, local: Curvature) -> SurfaceSamples:
        """Samples with normals, turned outward where they have no signs of their own."""
        if self.samples.oriented:
            return SurfaceSamples(self.samples.points, local.normals, areas=self.samples.areas)
        return outward_samples(self.samples, local, self._witnesses(local))
