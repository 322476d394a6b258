"""What a shape is made of: samples, a counted answer, a field, a mesh; immutable, made lazily, examined once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Self, TypeVar, cast

import numpy as np
import torch
from torch import Tensor

from topokit.core.grid.field import Field
from topokit.core.local.curvature import DEFAULT_NEIGHBORS
from topokit.core.local.neighborhood_size import automatic_neighbors, given_or_default
from topokit.core.loops import BoundaryLoop
from topokit.core.mesh.boundary_loops import mesh_boundary
from topokit.core.mesh.defects import Defect
from topokit.core.neighbors import nearest_neighbors
from topokit.core.precision import full_precision
from topokit.core.residence import stays_on_device
from topokit.core.samples import SurfaceSamples, enough_neighbors, enough_samples
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError, summary
from topokit.report.examination import Examination
from topokit.report.report import CountedAnswer

UNNAMED = "shape"
_NOT_PICKLED = ("_make_samples", "_make_counted", "_examined", "_neighbors")
Measured = TypeVar("Measured")
FindDefects = Callable[[bool], tuple[Defect, ...]]
"""The faults of what a shape was made from; told whether to look for self-intersections, too."""


class ShapeData:
    """The data of a `topokit.Shape`, which adds the questions.

    Tensors given as samples are not copied: after an in-place change, such as an optimizer step, everything is measured
    anew. What is made or counted from other tensors (vertices, volumes, networks) is made once. `Shape` describes
    the attributes. An adapter may also give `surface`, which makes the closed surface of its representation, and
    `defects`, which finds faults; without `surface` it is the mesh, or that of the global witness.
    """

    field: Field | None
    mesh: tuple[Tensor, Tensor] | None
    name: str
    notes: tuple[str, ...]
    n_neighbors: int | None

    def __init__(
        self,
        samples: SurfaceSamples | Callable[[], SurfaceSamples],
        counted: CountedAnswer | Callable[[], CountedAnswer | None] | None = None,
        *,
        surface: Callable[[], TriangleSurface] | None = None,
        defects: FindDefects | None = None,
        field: Field | None = None,
        mesh: tuple[Tensor, Tensor] | None = None,
        name: str = UNNAMED,
        notes: tuple[str, ...] = (),
        n_neighbors: int | None = None,
    ) -> None:
        own: dict[str, Any] = {
            "_make_surface": surface,
            "_find_defects": defects,
            "field": field,
            "mesh": mesh,
            "name": name,
            "notes": notes,
            "n_neighbors": n_neighbors,
        }
        own["_make_samples" if callable(samples) else "samples"] = samples
        own["_make_counted" if callable(counted) else "counted"] = counted
        if not callable(samples):
            enough_samples(samples, given_or_default(n_neighbors), name)
        self.__dict__.update(own)  # attributes cannot be set one by one, see __setattr__

    def __setattr__(self, attribute: str, value: object) -> None:
        raise AttributeError(f"a Shape is immutable: use shape.replace({attribute}=...) for a changed copy.")

    def __delattr__(self, attribute: str) -> None:
        raise AttributeError(f"a Shape is immutable: its {attribute} cannot be deleted.")

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: the samples and the counted answer instead of the functions that make them."""
        made = {"samples": self.samples, "counted": self.counted}
        return {name: value for name, value in self.__dict__.items() if name not in _NOT_PICKLED} | made

    def __repr__(self) -> str:
        known = self.__dict__
        counted = "counted, " if known.get("counted") is not None else ""
        count = f"{tuple(self.samples.points.shape)} samples" if "samples" in known else "no samples yet"
        return f"Shape({self.name!r}, {counted}{count})"

    @cached_property
    @full_precision
    def samples(self) -> SurfaceSamples:
        """The samples (..., N, 3), made when they are first needed."""
        with torch.inference_mode(False), torch.enable_grad():  # they outlive the mode in which they are first needed
            made = self.__dict__["_make_samples"]()
        return enough_samples(made, given_or_default(self.n_neighbors), self.name)

    @cached_property
    @full_precision
    def counted(self) -> CountedAnswer | None:
        """The counted answer, found when it is first needed, or None."""
        answer: CountedAnswer | None = self.__dict__["_make_counted"]()
        return answer

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
        unknown = sorted(set(changes) - {"name", "notes", "n_neighbors"})
        if unknown:
            raise InputError(f"a Shape's {', '.join(unknown)} cannot be replaced; name, notes and n_neighbors can.")
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__ | changes)
        enough_neighbors(given_or_default(other.n_neighbors))
        return other

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

    def _examinations(self) -> tuple[Examination, ...]:
        """The measurements of every batch item; made again if the tensors were changed in place."""
        return self._once("_examined", self._examine)

    def _examine(self) -> tuple[Examination, ...]:
        if stays_on_device(self.samples.points):
            self.samples.check_finite()

        def neighbors_of(number: int, count: int) -> Callable[[], Tensor]:
            return lambda: self._known_neighbors()[number, :count]

        return tuple(
            Examination(item, known_closed=self._known_closed, neighbors=neighbors_of(number, item.n_points))
            for number, item in enumerate(self.samples.items())
        )

    @property
    def _known_closed(self) -> bool:
        """Whether the surface was counted and has no boundary; the level set of a function may leave its box."""
        return self.field is None and self.counted is not None and self.counted.closed

    def _once(self, name: str, measure: Callable[[], Measured]) -> Measured:
        """What was measured, under a name; measured again if the tensors of the samples were changed in place."""
        versions, found = self.__dict__.get(name, (None, None))
        current = self.samples.versions()
        if versions != current:
            found = measure()
            self.__dict__[name] = current, found
        return cast(Measured, found)

    def _automatic_neighbors(self) -> int:
        """The number of neighbors that the samples' noise calls for; 20 for batches with padding."""
        if self.samples.lengths is not None:
            return DEFAULT_NEIGHBORS
        return self._once("_automatic", lambda: automatic_neighbors(self.samples.points, self._known_neighbors()))

    def _known_neighbors(self) -> Tensor:
        """(B, N, k) indices of the 20 nearest neighbors, or of as many as there are."""
        return self._once("_neighbors", self._search)

    def _search(self) -> Tensor:
        samples = self.samples
        k = min(DEFAULT_NEIGHBORS, samples.n_points - 1)
        with torch.inference_mode(False):  # the indices outlive the mode, and gradients must be able to save them
            found = nearest_neighbors(samples.points, k, lengths=samples.lengths)
        return found.reshape(-1, samples.n_points, k)

    def _refuse_batches(self) -> None:
        if self.samples.points.ndim != 2:
            raise InputError(
                f"a report is about one shape; the samples are batched, {tuple(self.samples.points.shape)}. "
                "Ask euler() for all of them, or make a shape of each item."
            )

    def _only_examination(self) -> Examination:
        self._refuse_batches()
        return self._examinations()[0]

    def _surface_found(self) -> TriangleSurface | None:
        """The closed surface as triangles, not compared with the report; None if there is none."""
        make: Callable[[], TriangleSurface] | None = self.__dict__["_make_surface"]
        if make is not None:
            return make()
        if self.mesh is not None:
            vertices, faces = (part.detach().cpu().numpy() for part in self.mesh)
            return TriangleSurface(vertices.astype(np.float64), faces).compact()
        witness = self._only_examination().witness
        if witness is None or witness.surface is None:
            return None
        points = self.samples.points.detach().cpu().double().numpy()
        return TriangleSurface(points[witness.surface.points], witness.surface.faces)

    def _boundary_found(self) -> tuple[BoundaryLoop, ...]:
        """The curves along which the surface ends, longest first."""
        if self.mesh is not None:
            vertices, faces = (part.detach().cpu().numpy() for part in self.mesh)
            return mesh_boundary(vertices.astype(np.float64), faces)
        if self.counted is not None:
            if self.counted.closed:
                return ()
            raise InputError(
                f"{self.name} is cut by the box in which it was looked for, and its curves there are not traced: pass "
                "larger bounds."
            )
        found = self._only_examination()
        points = found.samples.points.cpu().double().numpy()
        return tuple(BoundaryLoop.through(points, curve.index.numpy()) for curve in found.boundary.curves)

    def _with(self, samples: SurfaceSamples, mesh: tuple[Tensor, Tensor] | None) -> Self:
        """A copy with other samples; a counted answer that is not known yet stays so."""
        counted = self.__dict__.get("counted", self.__dict__.get("_make_counted"))
        own = {key: getattr(self, key) for key in ("field", "name", "notes", "n_neighbors")}
        own |= {"surface": self.__dict__["_make_surface"], "defects": self.__dict__["_find_defects"]}
        return type(self)(samples, counted, mesh=mesh, **own)
