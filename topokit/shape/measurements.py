"""The samples and the counted answer of a shape, made when they are first needed, and what is measured on them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar, cast

import torch
from torch import Tensor

from topokit.core.local.curvature import DEFAULT_NEIGHBORS, Curvature, CurvatureSettings, surface_curvature
from topokit.core.local.neighborhood_size import automatic_neighbors, given_or_default
from topokit.core.neighbors import first_neighbors, nearest_neighbors
from topokit.core.precision import full_precision
from topokit.core.residence import stays_on_device
from topokit.core.samples import SurfaceSamples, enough_samples
from topokit.errors import InputError
from topokit.report.counted import CountedAnswer
from topokit.report.examination import Examination, solid_eulers

if TYPE_CHECKING:
    from topokit.core.opacity.scene import AbsorbingScene

Measured = TypeVar("Measured")
GivenSamples = SurfaceSamples | Callable[[], SurfaceSamples]
GivenAnswer = CountedAnswer | Callable[[], CountedAnswer | None] | None


class Measurements:
    """What is known of a shape, each thing made or measured once, when it is first needed."""

    def __init__(
        self,
        samples: GivenSamples,
        counted: GivenAnswer,
        *,
        may_leave_box: bool,
        n_neighbors: int | None,
        name: str,
        opacity: AbsorbingScene | None = None,
    ) -> None:
        """
        Args:
            samples: of the surface, or what makes them.
            counted: the counted answer, what counts it, or None.
            may_leave_box: whether the surface may have a boundary though a closed one was counted: that of a field.
            n_neighbors: of the shape; there must be more samples.
            name: of the shape, for error messages.
            opacity: the scene that absorbs light, if the samples are of one.
        """
        self._opacity = opacity
        self._given_samples, self._given_counted = samples, counted
        self._may_leave_box, self._n_neighbors, self._name = may_leave_box, n_neighbors, name
        self._found: dict[str, tuple[tuple[int, ...], Any]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: the samples and the counted answer instead of the functions that make them."""
        made: dict[str, Any] = {"_given_samples": self.samples, "_given_counted": self.counted, "_found": {}}
        return {name: value for name, value in self.__dict__.items() if name.startswith("_")} | made

    def replace(self, n_neighbors: int | None, name: str) -> Measurements:
        """A copy for a shape with another number of neighbors or name; all that is known is shared."""
        other = object.__new__(Measurements)
        other.__dict__.update(self.__dict__ | {"_n_neighbors": n_neighbors, "_name": name})
        return other

    @cached_property
    @full_precision
    def samples(self) -> SurfaceSamples:
        """The samples (..., N, 3).

        Raises:
            InputError: if there are not more of them than neighbors of each.
        """
        given = self._given_samples
        with torch.inference_mode(False), torch.enable_grad():  # they outlive the mode of the first question
            made: SurfaceSamples = given() if callable(given) else given
        return enough_samples(made, given_or_default(self._n_neighbors), self._name)

    @cached_property
    @full_precision
    def counted(self) -> CountedAnswer | None:
        """The counted answer, or None."""
        return self._given_counted() if callable(self._given_counted) else self._given_counted

    @property
    def samples_so_far(self) -> SurfaceSamples | None:
        """The samples, or None if they would have to be made."""
        return self.samples if "samples" in self.__dict__ or not callable(self._given_samples) else None

    @property
    def counted_so_far(self) -> CountedAnswer | None:
        """The counted answer, or None if there is none or it would have to be counted."""
        return self.counted if "counted" in self.__dict__ or not callable(self._given_counted) else None

    @property
    def counted_or_given(self) -> GivenAnswer:
        """The counted answer, or what counts it, for a shape with other samples."""
        return self.counted if "counted" in self.__dict__ else self._given_counted

    @property
    def known_closed(self) -> bool:
        """Whether the surface was counted and has no boundary."""
        return not self._may_leave_box and self.counted is not None and self.counted.closed

    def _once(self, name: str, measure: Callable[[], Measured]) -> Measured:
        """What was measured, under a name; measured again if the tensors of the samples were changed in place."""
        versions, found = self._found.get(name, (None, None))
        current = self.samples.versions()
        if versions != current:
            found = measure()
            self._found[name] = current, found
        return cast(Measured, found)

    def neighbors(self) -> Tensor:
        """(B, N, k) indices of the 20 nearest neighbors, or of as many as there are."""
        return self._once("neighbors", self._search)

    def _search(self) -> Tensor:
        samples = self.samples
        k = min(DEFAULT_NEIGHBORS, samples.n_points - 1)
        with torch.inference_mode(False):  # the indices outlive the mode, and gradients must be able to save them
            found = nearest_neighbors(samples.points, k, lengths=samples.lengths)
        return found.reshape(-1, samples.n_points, k)

    def automatic_neighbors(self) -> int:
        """The number of neighbors that the samples' noise calls for; 20 for batches with padding."""
        if self.samples.lengths is not None:
            return DEFAULT_NEIGHBORS
        return self._once("automatic", lambda: automatic_neighbors(self.samples.points, self.neighbors()))

    def examinations(self) -> tuple[Examination, ...]:
        """The measurements behind the verdict on every batch item."""
        return self._once("examinations", self._examine)

    def _examine(self) -> tuple[Examination, ...]:
        if stays_on_device(self.samples.points):
            self.samples.check_finite()

        def neighbors_of(number: int, count: int) -> Callable[[], Tensor]:
            return lambda: self.neighbors()[number, :count]

        return tuple(
            Examination(
                item,
                known_closed=self.known_closed,
                neighbors=neighbors_of(number, item.n_points),
                opacity=self._opacity,
            )
            for number, item in enumerate(self.samples.items())
        )

    def examination(self) -> Examination:
        """That of samples that are not batched.

        Raises:
            InputError: if they are.
        """
        if self.samples.points.ndim != 2:
            raise InputError(
                f"a report is about one shape; the samples are batched, {tuple(self.samples.points.shape)}. "
                "Ask euler() for all of them, or make a shape of each item."
            )
        return self.examinations()[0]

    def curvature(self, settings: CurvatureSettings) -> Curvature:
        """Curvature with the neighbors that are known, where those are enough."""
        known = self.neighbors().reshape(*self.samples.points.shape[:-1], -1)
        return surface_curvature(self.samples, settings, neighbors=first_neighbors(known, settings.n_neighbors))

    def boundary_euler(self, like: Tensor) -> Tensor:
        """The boundary's share of χ, (...), in the type and on the device of a tensor."""
        lead = self.samples.points.shape[:-2]
        if self.known_closed:
            return like.new_zeros(lead)
        return like.new_tensor([found.part.boundary.euler for found in self.examinations()]).reshape(lead)

    def integer(self, like: Tensor) -> Tensor | None:
        """The integer of the count, 0-d, else of the witness, (...); None if there is neither."""
        if self.counted is not None and self.counted.evidence.integer is not None:
            return like.new_tensor(self.counted.evidence.integer)
        eulers = solid_eulers(self.examinations())
        return None if eulers is None else like.new_tensor(eulers).reshape(self.samples.points.shape[:-2])
