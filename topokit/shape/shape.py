"""Shape: what every adapter returns and what users ask."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NoReturn, Self

import torch
from torch import Tensor

from topokit.core.cloud.sampling.downsampling import Criterion, fewer_samples
from topokit.core.grid.field import Field
from topokit.core.grid.winding_field import regularized_samples
from topokit.core.local.curvature import DEFAULT_NEIGHBORS
from topokit.core.local.neighborhood_size import given_or_default
from topokit.core.loops import BoundaryLoop
from topokit.core.mesh.defects import Defect
from topokit.core.samples import SurfaceSamples, enough_neighbors
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError, summary
from topokit.report.cloud import cloud_report, with_doubts
from topokit.report.counted import CountedAnswer, counted_report
from topokit.report.examination import outward_samples
from topokit.report.report import TopologyReport, known_genus
from topokit.report.simplification import Simplification
from topokit.shape import estimates, facts, outputs
from topokit.shape.certified import Bounded, certified_report, certify
from topokit.shape.compare import compare
from topokit.shape.details import with_details
from topokit.shape.features import features, narrow_places, with_features
from topokit.shape.levels import Levels, euler_curve
from topokit.shape.locate import handles, with_location
from topokit.shape.measurements import GivenAnswer, GivenSamples, Measurements
from topokit.shape.mending import enforce, fill_boundaries, goal, save, simplify
from topokit.shape.surface import boundary_of, surface_with_rims
from topokit.shape.transform import euler_transform
from topokit.text import no_attribute

if TYPE_CHECKING:
    import trimesh

    from topokit.core.blocks.curve import EulerCurve
    from topokit.core.opacity.scene import AbsorbingScene


UNNAMED = "shape"


class Shape:
    """A surface as samples, with a counted answer where its representation has one. Immutable.

    Answers do not depend on the order of questions, and the report does not depend on `n_neighbors`. Points given as
    tensors are not copied: after an in-place change, such as an optimizer step, everything is measured anew. Samples
    that are made from other tensors (vertices, splats, the weights of a network) are made once, with one graph: make a
    new shape for every training step.

    Args:
        samples: points (..., N, 3) with normals, frames and areas as far as known, or a function that makes them.
        counted: the counted answer, or a function that counts, or None.
        surface: makes the closed surface of the representation; without it that is the mesh, or that of the global
            witness.
        defects: finds faults; gets whether to look for self-intersections, too.
        bounded: proves the topology of a function's level set by bounds.
        curve: counts the solids over all levels, given the levels of `euler_curve`, if the shape has no field.
        opacity: the scene that absorbs light, of which the solid that cannot be seen into is asked where samples alone
            are unsure.
        left_out: width, in units of length, of the widest part that was taken for a floater and is not in the samples;
            an answer that claims to see parts so narrow is unsure.
        field: the scalar field that defines the shape, on its own grid, or None.
        stored: the volume of a shape that is counted block by block, for what changes it, or None.
        mesh: (vertices (V, 3), faces (F, 3)) if the shape was made from a mesh, else None.
        name: what to call it in reports.
        notes: sentences about what was found or changed while opening it; the report repeats them.
        n_neighbors: number of nearest neighbors for `curvature`, `gauss_bonnet` and `refined_euler`. None, the default,
            takes 20, or more where the samples are noisy.
        simplification: what `simplify` did, if the shape is its result.
        advice: what to change in the call that made the shape if its samples give no sure answer.

    All but those from `surface` to `left_out` are attributes, too; what functions make is made when it is needed.
    """

    field: Field | None
    stored: object
    mesh: tuple[Tensor, Tensor] | None
    name: str
    notes: tuple[str, ...]
    n_neighbors: int | None
    simplification: Simplification | None
    advice: str | None
    _known: Measurements
    _make_surface: Callable[[], TriangleSurface] | None
    _find_defects: Callable[[bool], tuple[Defect, ...]] | None
    _bounded: Bounded | None
    _curve: Callable[[Levels], EulerCurve] | None
    _opacity: AbsorbingScene | None
    _left_out: float

    def __init__(
        self,
        samples: GivenSamples,
        counted: GivenAnswer = None,
        *,
        surface: Callable[[], TriangleSurface] | None = None,
        defects: Callable[[bool], tuple[Defect, ...]] | None = None,
        bounded: Bounded | None = None,
        curve: Callable[[Levels], EulerCurve] | None = None,
        opacity: AbsorbingScene | None = None,
        left_out: float = 0.0,
        field: Field | None = None,
        stored: object = None,
        mesh: tuple[Tensor, Tensor] | None = None,
        name: str = UNNAMED,
        notes: tuple[str, ...] = (),
        n_neighbors: int | None = None,
        simplification: Simplification | None = None,
        advice: str | None = None,
    ) -> None:
        known = Measurements(
            samples, counted, may_leave_box=field is not None, n_neighbors=n_neighbors, name=name, opacity=opacity
        )
        _ = known.samples_so_far  # checked now, if they are known
        self.__dict__.update(  # attributes cannot be set one by one, see __setattr__
            field=field,
            stored=stored,
            mesh=mesh,
            name=name,
            notes=notes,
            n_neighbors=n_neighbors,
            simplification=simplification,
            advice=advice,
            _known=known,
            _make_surface=surface,
            _find_defects=defects,
            _bounded=bounded,
            _curve=curve,
            _opacity=opacity,
            _left_out=left_out,
        )

    def __setattr__(self, attribute: str, value: object) -> None:
        raise AttributeError(f"a Shape is immutable: use shape.replace({attribute}=...) for a changed copy.")

    def __delattr__(self, attribute: str) -> None:
        raise AttributeError(f"a Shape is immutable: its {attribute} cannot be deleted.")

    if not TYPE_CHECKING:  # a type checker would take any name for an attribute

        def __getattr__(self, attribute: str) -> object:
            if attribute in dir(type(self)):  # a property that failed: its own error is the one to show
                return object.__getattribute__(self, attribute)
            raise AttributeError(no_attribute("a Shape", attribute, dir(type(self)), facts.OTHER_WORDS), name=attribute)

    def __array__(self, *args: object, **kwargs: object) -> NoReturn:
        """Refused: NumPy would make an array without axes of any object."""
        raise InputError(
            f"{self.name} is a shape, not an array: take samples.points or field.volume, or write a file with save()."
        )

    def __repr__(self) -> str:
        counted = "" if self._known.counted_so_far is None else "counted, "
        samples = self._known.samples_so_far
        count = "no samples yet" if samples is None else f"{tuple(samples.points.shape)} samples"
        return f"Shape({self.name!r}, {counted}{count})"

    @property
    def samples(self) -> SurfaceSamples:
        """The samples (..., N, 3), made when they are first needed."""
        return self._known.samples

    @property
    def counted(self) -> CountedAnswer | None:
        """The counted answer, found when it is first needed, or None."""
        return self._known.counted

    @property
    def device(self) -> torch.device:
        """Device of the samples."""
        return self.samples.points.device

    @property
    def dtype(self) -> torch.dtype:
        """Floating type of the samples."""
        return self.samples.points.dtype

    def replace(self, **changes: Any) -> Self:
        """A copy with another `name`, `notes` or `n_neighbors`; everything measured is shared.

        Raises:
            InputError: for any other attribute.
        """
        unknown = sorted(set(changes) - {"name", "notes", "n_neighbors", "simplification"})
        if unknown:
            raise InputError(f"a Shape's {', '.join(unknown)} cannot be replaced; name, notes and n_neighbors can.")
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__ | changes)
        enough_neighbors(given_or_default(other.n_neighbors))
        other.__dict__["_known"] = self._known.replace(other.n_neighbors, other.name)
        return other

    def _with(self, samples: SurfaceSamples, mesh: tuple[Tensor, Tensor] | None) -> Self:
        """A copy with other samples; a counted answer that is not known yet stays so."""
        return type(self)(
            samples,
            self._known.counted_or_given,
            surface=self._make_surface,
            defects=self._find_defects,
            bounded=self._bounded,
            curve=self._curve,
            opacity=self._opacity,
            left_out=self._left_out,
            field=self.field,
            stored=self.stored,
            mesh=mesh,
            name=self.name,
            notes=self.notes,
            n_neighbors=self.n_neighbors,
            simplification=self.simplification,
            advice=self.advice,
        )

    def to(self, *args: Any, **kwargs: Any) -> Self:
        """The shape with its samples and mesh on another device or in another floating type.

        Arguments as for `torch.Tensor.to`. A field stays where it is.

        Raises:
            InputError: if there is no such device or type here; the message is that of torch.
        """
        mesh = self.mesh
        try:
            samples = self.samples.to(*args, **kwargs)
        except torch.OutOfMemoryError:
            raise
        except (AssertionError, RuntimeError) as error:  # the first if torch is made without such devices
            raise InputError(f"{self.name} cannot be moved there ({summary(error)}).") from error
        if mesh is not None:
            mesh = mesh[0].to(*args, **kwargs), mesh[1].to(samples.points.device)
        return self._with(samples, mesh)

    def genus(self, *, above: float | None = None, cap: bool | float = True) -> int:
        """Handles summed over components, from the report's integer.

        Args:
            above: count only handles at least so wide, in units of length; see `features`.
            cap: whether an open surface has a genus: that of the surface with a disc in each of its rims, whose widths
                the report says. A width, in units of length, closes rims up to it; False accepts closed surfaces only.

        Raises:
            GenusError: if the surface is not a manifold or not orientable, its genus is unknown, or it is open and
                `cap` is False or less than the width of a rim; the message names the call that says more.
            InputError: with `above`, as for `features`; if `cap` is no positive width.
        """
        if above is not None:
            return self.features(above).above(above).genus
        manifold = None if self.counted is None else self.counted.manifold
        return known_genus(self.report(), self.boundaries, is_manifold=manifold, cap=cap)

    def report(
        self,
        *,
        details: bool = False,
        locate: bool = False,
        features: bool | float = False,
        certify: bool | None = None,
    ) -> TopologyReport:
        """The topology of the surface with a verdict, reasons and evidence.

        A counted answer is reported as it is; samples without one are judged by the global witness.

        Args:
            details: whether to compute what the integer does not need, too: the curvature estimate χ⁽⁰⁾ of a counted
                shape, the self-optimized χ⁽ᴷ⁾, the solid that a mesh encloses by winding number, and at which
                levels the answer of a gray volume or a function stays (`level_range`).
            locate: whether to look for the places of handles, boundaries and, in a mesh, defects.
            features: whether to measure how wide parts, tunnels and cavities are (see `features`): those from the
                default width on, or from the given one; and at which places a cloud is narrower than its resolution
                (see `narrow_places`), which is also looked for if the verdict is "unsure".
            certify: of a function, whether to prove its level set by bounds (see `certify`). None tries it beside the
                grids, for about as many evaluations as these took: the answer becomes "certain", or "unsure" where
                bounds find parts that grids miss. True tries a minute, without grids; where it fails, grids answer, and
                the report says what stays open. False asks the grids alone. It changes nothing for other shapes.

        Raises:
            InputError: if the samples are batched; or as for `certify`.
        """
        if self._bounded is not None and certify is not False:
            report = certified_report(self, self._bounded, without_grids=certify is True)
        else:
            if self.counted is None:
                self._known.examination()  # refuses batches
            [report] = self._reports()
        report = with_location(report, self) if locate else report
        if features is not False:
            report = with_features(report, self, None if features is True else features)
            if self.counted is None and report.closed:
                report = with_doubts(report, self._known.examination())
        return with_details(report, self, self._known.automatic_neighbors()) if details else report

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
        found = self._known.examinations()
        for one in found:
            if one.refusal is not None:
                raise one.refusal
        return self._with(outward_samples(self.samples, self.curvature().normals, found), self.mesh)

    def surface(self) -> trimesh.Trimesh:
        """The surface as triangles, facing outward, with V − E + F equal to `report().euler`.

        It is closed, or that of an open cloud, which ends at its rims. It is checked before it is returned: every edge
        has two faces, or one at a rim, every vertex one fan, and the counts are the reported ones. Vertices are not
        differentiable.

        Raises:
            InputError: if an open mesh or level set was given, or no surface with the reported numbers was found; the
                message says which.
        """
        from topokit.export.trimesh import as_trimesh

        return as_trimesh(surface_with_rims(self))

    def boundaries(self) -> tuple[BoundaryLoop, ...]:
        """The curves along which the surface ends, longest first; none if it is closed.

        Those of a mesh run along its edges with one face. Those of a cloud run through its samples and are found only
        if they are longer than about twenty sample spacings and can be traced.

        Raises:
            InputError: if the samples are batched, or a function's level set is cut by its box.
        """
        return boundary_of(self)

    def defects(self, *, self_intersections: bool = True) -> tuple[Defect, ...]:
        """What is wrong with the mesh, and where: one record for each place.

        Non-manifold edges, pinched vertices, self-intersections, flipped, duplicate and degenerate faces, tiny
        components and cavities. The faces are rows of `shape.mesh[1]`.

        Args:
            self_intersections: whether to look for faces that cross each other; this takes longest, and needs libigl.

        Raises:
            InputError: if the shape was not made from a mesh.
            MissingDependencyError: if self-intersections are wanted and libigl is not installed.
        """
        if self._find_defects is None:
            raise InputError(f"{self.name} was not made from a mesh; only meshes have defects of this kind.")
        return self._find_defects(self_intersections)

    def downsample(self, n_samples: int, by: Criterion = "feature-size") -> Shape:
        """The shape with fewer samples, taken where its surface needs them; what was counted and its mesh are kept.

        Args:
            n_samples: number of samples to keep, at most.
            by: "feature-size": densely where the surface bends or an opposite sheet is near (with outward normals, both
                sides of a thin wall are kept, however coarsely); "curvature": where it bends; "even": everywhere alike.

        Returns:
            A `Shape` with the normals and frames of the samples that are kept and the summed areas of those that they
            stand for; differentiable at a fixed choice. Deterministic.

        Raises:
            InputError: if the samples are batched, or too few are wanted for the shape's number of neighbors.

        Example:
            >>> import topokit as tk
            >>> from topokit.testing import torus_samples
            >>> tk.from_points(torus_samples(20_000).points).downsample(2000).samples.n_points <= 2000
            True
        """
        return self._with(fewer_samples(self.samples, n_samples, by), self.mesh)

    def regularized(self) -> Self:
        """The shape with its samples moved onto the surface where their winding number is one half.

        Normals come from the winding number's gradient. This takes noise out of positions and normals; how much it
        smooths follows from the noise that is found, and edges are rounded by as much. Without normals the shape is
        `oriented()` first.

        Returns:
            A shape with outward normals, differentiable in the points at a fixed grid: the winding number is found on a
            grid that follows from the points, whose position and size are constants to the gradient.

        Raises:
            InputError: if the points bound no solid, or the samples are batched.

        Reference:
            Paper, Section II-C, supervision by the global winding number.
        """
        oriented = self.oriented()
        areas = oriented.curvature(DEFAULT_NEIGHBORS).area
        k = self.n_neighbors or self._known.automatic_neighbors()
        return self._with(regularized_samples(oriented.samples, areas, k), None)

    is_closed = property(facts.is_closed)
    n_components = property(facts.n_components)
    bounds = property(facts.bounds)
    area = property(facts.area)
    volume = property(facts.volume)
    betti = facts.betti
    minkowski = facts.minkowski
    compare = compare
    split = facts.split
    save = save
    simplify = simplify
    enforce = enforce
    goal = goal
    fill_boundaries = fill_boundaries

    to_trimesh = outputs.to_trimesh
    save_ply = outputs.save_ply
    save_html = outputs.save_html
    picture = outputs.picture
    show = plot = outputs.show
    _repr_html_ = outputs.notebook_html

    certify = certify
    euler_curve = euler_curve
    euler_transform = euler_transform
    features = features
    handles = handles
    narrow_places = narrow_places
    curvature = estimates.curvature
    euler = estimates.euler
    gauss_bonnet = estimates.gauss_bonnet
    refined_euler = estimates.refined_euler
    smoothed_euler = estimates.smoothed_euler

    def _reports(self) -> tuple[TopologyReport, ...]:
        """The report of the counted answer, or of each batch item's samples."""
        if self.counted is not None:
            return (counted_report(self.name, self.notes, self.counted),)
        return tuple(
            cloud_report(self.name, self.notes, found, self.advice, self._left_out)
            for found in self._known.examinations()
        )
