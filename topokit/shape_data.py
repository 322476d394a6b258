"""What a shape is made of: samples, a counted answer, a field, a mesh; immutable, made lazily, examined once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Self

import torch
from torch import Tensor

from topokit.core.grid.field import Field
from topokit.core.local.neighborhood_size import automatic_neighbors, given_or_default
from topokit.core.samples import SurfaceSamples, enough_neighbors, enough_samples
from topokit.errors import InputError
from topokit.report.examination import Examination
from topokit.report.report import CountedAnswer

UNNAMED = "shape"


class ShapeData:
    """The data of a `topokit.Shape`, which adds the questions.

    Tensors given as samples are not copied: after an in-place change, such as an optimizer step, everything is measured
    anew. What is made or counted from other tensors (vertices, volumes, networks) is made once. `Shape` describes
    the attributes.
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
        field: Field | None = None,
        mesh: tuple[Tensor, Tensor] | None = None,
        name: str = UNNAMED,
        notes: tuple[str, ...] = (),
        n_neighbors: int | None = None,
    ) -> None:
        own: dict[str, Any] = {"field": field, "mesh": mesh, "name": name, "notes": notes, "n_neighbors": n_neighbors}
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
        names = ("samples", "counted", "field", "mesh", "name", "notes", "n_neighbors")
        return {name: getattr(self, name) for name in names}

    def __repr__(self) -> str:
        known = self.__dict__
        counted = "counted, " if known.get("counted") is not None else ""
        count = f"{tuple(self.samples.points.shape)} samples" if "samples" in known else "no samples yet"
        return f"Shape({self.name!r}, {counted}{count})"

    @cached_property
    def samples(self) -> SurfaceSamples:
        """The samples (..., N, 3), made when they are first needed."""
        with torch.inference_mode(False), torch.enable_grad():  # they outlive the mode in which they are first needed
            made = self.__dict__["_make_samples"]()
        return enough_samples(made, given_or_default(self.n_neighbors), self.name)

    @cached_property
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
        """
        samples, mesh = self.samples.to(*args, **kwargs), self.mesh
        if mesh is not None:
            mesh = mesh[0].to(*args, **kwargs), mesh[1].to(samples.points.device)
        return self._with(samples, mesh)

    def _examinations(self) -> tuple[Examination, ...]:
        """The measurements of every batch item; made again if the tensors were changed in place."""
        versions, found = self.__dict__.get("_examined", (None, ()))
        current = self.samples.versions()
        if versions != current:
            known_closed = self.field is None and self.counted is not None and self.counted.closed
            found = tuple(Examination(item, known_closed=known_closed) for item in self.samples.items())
            self.__dict__["_examined"] = current, found
        return found

    def _automatic_neighbors(self) -> int:
        """The number of neighbors that the samples' noise calls for; found again if they were changed in place."""
        versions, found = self.__dict__.get("_automatic", (None, 0))
        current = self.samples.versions()
        if versions != current:
            found = automatic_neighbors(self.samples.points, self._known_neighbors())
            self.__dict__["_automatic"] = current, found
        return found

    def _known_neighbors(self) -> Tensor:
        """(B, N, k) indices of the neighbors that the examinations have found."""
        return torch.stack([one.neighbors for one in self._examinations()])

    def _only_examination(self) -> Examination:
        if self.samples.points.ndim != 2:
            raise InputError(
                f"a report is about one shape; the samples are batched, {tuple(self.samples.points.shape)}. "
                "Ask euler() for all of them, or make a shape of each item."
            )
        return self._examinations()[0]

    def _with(self, samples: SurfaceSamples, mesh: tuple[Tensor, Tensor] | None) -> Self:
        """A copy with other samples; a counted answer that is not known yet stays so."""
        counted = self.__dict__.get("counted", self.__dict__.get("_make_counted"))
        own = {key: getattr(self, key) for key in ("field", "name", "notes", "n_neighbors")}
        return type(self)(samples, counted, mesh=mesh, **own)
