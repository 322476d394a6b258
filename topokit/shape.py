"""Shape: what every adapter returns and what users ask."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from topokit.core.local.curvature import Curvature, CurvatureSettings, surface_curvature
from topokit.core.local.descent import Variable
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.local.self_optimization import LEARNING_RATE, Step, corrected, self_optimize
from topokit.core.local.voronoi import AreaMethod
from topokit.core.local.weingarten import Solver
from topokit.errors import InputError
from topokit.report.cloud import cloud_report
from topokit.report.counted import counted_report
from topokit.report.details import with_details
from topokit.report.examination import outward_samples, solid_eulers
from topokit.report.report import TopologyReport, known_genus
from topokit.shape_data import ShapeData

if TYPE_CHECKING:
    import trimesh

    from topokit.export.colors import Quantity


class Shape(ShapeData):
    """A surface as samples, with a counted answer where its representation has one. Immutable.

    Answers do not depend on the order of questions, and the report does not depend on `n_neighbors`. Points given as
    tensors are not copied: after an in-place change, such as an optimizer step, everything is measured anew. Samples
    that are made from other tensors (vertices, splats, the weights of a network) are made once, with one graph: make a
    new shape for every training step.

    Attributes:
        samples: points (..., N, 3) with normals, frames and areas as far as known; may be given as a function.
        counted: the counted answer or None; may be given as a function.
        field: the scalar field that defines the shape, on its own grid, or None.
        mesh: (vertices (V, 3), faces (F, 3)) if the shape was made from a mesh, else None.
        name: what to call it in reports.
        notes: sentences about what was found or changed while opening it; the report repeats them.
        n_neighbors: number of nearest neighbors for `curvature`, `euler` and `refined_euler`.
    """

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
            n_neighbors: number of nearest neighbors; the shape's own by default.
            solver: "sylvester", "symmetrized", "plain" or "commuting" (see `topokit.core.local.weingarten`).
            area_method: "exact" or "monte-carlo" (see `topokit.core.local.voronoi`).
            area_resolution: side of the Monte Carlo grid.

        Returns:
            `Curvature`, differentiable in whatever the shape was made from. H is positive where the surface bends
            towards its inside; without oriented normals its sign is meaningless.
        """
        return self._curvature(self._settings(n_neighbors, solver, area_method, area_resolution))

    def euler(
        self,
        n_neighbors: int | None = None,
        *,
        solver: Solver = "sylvester",
        area_method: AreaMethod = "exact",
        area_resolution: int = 32,
    ) -> Tensor:
        """χ⁽⁰⁾: the Euler characteristic estimated from curvature by Gauss–Bonnet, a differentiable real number.

        χ⁽⁰⁾ = (1/2π) Σ K·A, plus the geodesic curvature of the boundary where the samples have one. It asks no witness:
        `report().euler` is the integer, `refined_euler()` the estimate after self-optimization.

        Args:
            n_neighbors: number of nearest neighbors; the shape's own by default.
            solver: as for `curvature`.
            area_method: as for `curvature`.
            area_resolution: as for `curvature`.

        Returns:
            0-d tensor, or (...) for batched samples, differentiable in whatever the shape was made from. The term of
            the boundary is constant.

        Reference:
            Paper, equation `euler`.
        """
        local = self._curvature(self._settings(n_neighbors, solver, area_method, area_resolution))
        return euler_characteristic(local.gaussian, local.area) + self._boundary_euler(local.area)

    def refined_euler(
        self,
        target: Tensor | float | None = None,
        n_neighbors: int | None = None,
        *,
        over: Sequence[Variable] = ("normals",),
        step: Step = "polyak",
        learning_rate: float = LEARNING_RATE,
        max_steps: int | None = None,
        tolerance: float = 1e-3,
        solver: Solver = "sylvester",
        area_method: AreaMethod = "exact",
        area_resolution: int = 32,
    ) -> Tensor:
        """χ⁽ᴷ⁾: the Gauss–Bonnet estimate after self-optimization of the samples (Algorithm 2).

        The gradient is that of the sum at the optimized samples with the corrections held fixed; the refined value
        itself is nearly constant.

        Args:
            target: what χ must become, a number or (...). By default the counted integer, else that of the global
                witness; without either (planes, lines, open sheets) nothing is optimized.
            n_neighbors: number of nearest neighbors; the shape's own by default.
            over: what may change: "normals", "points", "areas".
            step: "polyak", or "gradient" for the paper's plain descent.
            learning_rate: of "gradient"; see `topokit.core.local.self_optimization.self_optimize`.
            max_steps: largest number of steps; 20 for "polyak" and 500 for "gradient" by default.
            tolerance: distance from the target at which to stop.
            solver: as for `curvature`.
            area_method: as for `curvature`.
            area_resolution: as for `curvature`.

        Returns:
            0-d tensor, or (...) for batched samples, differentiable in whatever the shape was made from.

        Reference:
            Paper, Section II-C and Algorithm 2, steps 8 and 9.
        """
        settings = self._settings(n_neighbors, solver, area_method, area_resolution)
        local = self._curvature(settings)
        boundary = self._boundary_euler(local.area)
        goal = self._target(local.area) if target is None else torch.as_tensor(target).to(local.area)
        if goal is None:
            return euler_characteristic(local.gaussian, local.area) + boundary
        oriented = outward_samples(self.samples, local.normals, self._examinations())
        refinement = self_optimize(
            oriented,
            goal.expand(boundary.shape) - boundary,
            settings=settings,
            over=over,
            step=step,
            learning_rate=learning_rate,
            max_steps=max_steps,
            tolerance=tolerance,
            neighbors=local.neighbors,
        )
        refined = surface_curvature(corrected(oriented, refinement, local.area), settings, neighbors=local.neighbors)
        return euler_characteristic(refined.gaussian, refined.area) + boundary

    def smoothed_euler(self, tau: float | None = None) -> Tensor:
        """χ_τ: the Euler characteristic of the shape's field averaged over levels near its own.

        This is the value whose gradient moves topology. It is computed on the field's own grid, in its connectivity.

        Args:
            tau: scale of the levels, in units of the field; see `topokit.core.grid.field.default_tau` for the default.
                0 gives the exact integer of the grid, without a gradient.

        Returns:
            0-d tensor, differentiable for tau > 0 in whatever the field was made from.

        Raises:
            InputError: if the shape has no field, or tau is negative or not finite.
        """
        if self.field is None:
            raise InputError(
                f"{self.name} has no field, so it has no smoothed Euler characteristic: only shapes from from_sdf, "
                "from_occupancy and from_voxels have one."
            )
        return self.field.smoothed_euler(tau)

    def genus(self) -> int:
        """Handles summed over components, from the report's integer.

        Raises:
            GenusError: if the surface is not a manifold or not orientable, or its genus is unknown.
        """
        return known_genus(self.report())

    def report(self, *, details: bool = False) -> TopologyReport:
        """The topology of the surface with a verdict, reasons and evidence.

        A counted answer is reported as it is; samples without one are judged by the global witness.

        Args:
            details: whether to compute what the integer does not need, too: the curvature estimate χ⁽⁰⁾ of a counted
                shape, the self-optimized χ⁽ᴷ⁾, and the solid that a mesh encloses by winding number.

        Raises:
            InputError: if the samples are batched.
        """
        if self.counted is not None:
            report = counted_report(self.name, self.notes, self.counted)
        else:
            report = cloud_report(self.name, self.notes, self._only_examination())
        return with_details(report, self) if details else report

    def oriented(self) -> Shape:
        """The shape with outward normals, found by the global witness where its own have no signs.

        Signs that were given are kept; the report says if they point inward or contradict each other.

        Returns:
            A `Shape` whose normals are differentiable in the points; this one if it is oriented already.

        Raises:
            InputError: if the points bound no solid, so that there is no outside.
        """
        if self.samples.oriented:
            return self
        found = self._examinations()
        for one in found:
            if one.refusal is not None:
                raise one.refusal
        return self._with(outward_samples(self.samples, self.curvature().normals, found), self.mesh)

    def to_trimesh(self, color_by: Quantity | None = None) -> trimesh.Trimesh:
        """The mesh as a `trimesh.Trimesh`; nothing is merged.

        Args:
            color_by: "gaussian", "mean" or "total" adds curvature as vertex colors and attributes (see
                `topokit.export.to_trimesh`); None leaves the mesh bare.

        Raises:
            InputError: if the shape was not made from a mesh.
        """
        from topokit.export.trimesh import to_trimesh

        return to_trimesh(self, color_by)

    def save_ply(self, path: str | os.PathLike[str], color_by: Quantity = "gaussian") -> int:
        """Write curvature as colors and scalar fields of a PLY file; see `topokit.export.save_ply`."""
        from topokit.export.ply import save_ply

        return save_ply(self, path, color_by)

    def _settings(
        self, n_neighbors: int | None, solver: Solver, area_method: AreaMethod, area_resolution: int
    ) -> CurvatureSettings:
        k = self.n_neighbors if n_neighbors is None else n_neighbors
        return CurvatureSettings(k, solver, area_method, area_resolution)

    def _curvature(self, settings: CurvatureSettings) -> Curvature:
        """Curvature with the neighbors that the examination has found already, where those are enough."""
        found = torch.stack([one.neighbors for one in self._examinations()])
        k, neighbors = settings.n_neighbors, None
        if k <= found.shape[-1]:
            neighbors = found[..., :k].reshape(*self.samples.points.shape[:-1], k)
        return surface_curvature(self.samples, settings, neighbors=neighbors)

    def _boundary_euler(self, like: Tensor) -> Tensor:
        """The boundary's share of χ, (...)."""
        shares = [found.boundary.euler for found in self._examinations()]
        return like.new_tensor(shares).reshape(self.samples.points.shape[:-2])

    def _target(self, like: Tensor) -> Tensor | None:
        """The integer of the count, else of the witness, 0-d or (...); None if there is neither."""
        if self.counted is not None and self.counted.evidence.integer is not None:
            return like.new_tensor(self.counted.evidence.integer)
        eulers = solid_eulers(self._examinations())
        return None if eulers is None else like.new_tensor(eulers).reshape(self.samples.points.shape[:-2])
