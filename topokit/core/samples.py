"""Oriented surface samples: what every representation becomes before the core sees it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import torch
from torch import Tensor

from topokit.errors import InputError


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Points on a surface, with whatever is already known about the surface there.

    Attributes:
        points: (..., N, 3), any unit of length.
        normals: (..., N, 3) or None (then estimated by local PCA). Need not be unit vectors; must not be zero.
        frames: (..., N, 3, 3) or None; rows t, t', n of an orthonormal moving frame. Takes precedence over `normals`.
        areas: (..., N) or None (then the tangent Voronoi areas), in squared units of length.
        oriented: True if the normals point outward. If False, or if there are no normals, neighboring normals are
            aligned with the center's before they are compared: the Gaussian curvature does not depend on the signs,
            and the sign of the mean curvature is arbitrary.

    Raises:
        InputError: on wrong shapes, types, devices or values that are not finite; or if the points span so much or so
            little that areas and curvature leave the range of their type.
    """

    points: Tensor
    normals: Tensor | None = None
    frames: Tensor | None = None
    areas: Tensor | None = None
    oriented: bool = True

    def __post_init__(self) -> None:
        _check(self.points, "points")
        if self.points.ndim < 2 or self.points.shape[-1] != 3:
            raise InputError(f"points must have shape (..., N, 3), got {tuple(self.points.shape)}.")
        _check_extent(self.points.detach())
        shape = self.points.shape
        expected = {"normals": shape, "frames": (*shape, 3), "areas": shape[:-1]}
        for name, wanted in expected.items():
            value = getattr(self, name)
            if value is None:
                continue
            _check(value, name)
            if value.shape != torch.Size(wanted):
                raise InputError(
                    f"{name} must have shape {tuple(wanted)} to match the points, got {tuple(value.shape)}."
                )
            if value.device != self.points.device or value.dtype != self.points.dtype:
                raise InputError(
                    f"{name} is {value.dtype} on {value.device}, the points are {self.points.dtype} on "
                    f"{self.points.device}: convert one of them."
                )
        if self.normals is None and self.frames is None:
            object.__setattr__(self, "oriented", False)

    @property
    def n_points(self) -> int:
        """Number of points N of each batch item."""
        return self.points.shape[-2]

    def known_normals(self) -> Tensor | None:
        """Normals (..., N, 3) as given, or the third axis of the frames; None if there are neither."""
        return self.frames[..., 2, :] if self.frames is not None else self.normals

    def to(self, *args: Any, **kwargs: Any) -> SurfaceSamples:
        """The samples on another device or in another floating type; arguments as for `torch.Tensor.to`."""
        return self._map(lambda value, kept: value.to(*args, **kwargs))

    def versions(self) -> tuple[int, ...]:
        """Counters that change when a tensor is changed in place; tensors of inference mode have none."""
        tensors = (self.points, self.normals, self.frames, self.areas)
        return tuple(0 if one.is_inference() else one._version for one in tensors if one is not None)

    def items(self) -> tuple[SurfaceSamples, ...]:
        """The samples of each batch item, detached, in the order of the merged batch dimensions."""
        n_points = self.n_points
        merged = self._map(lambda value, kept: value.detach().reshape(-1, n_points, *value.shape[value.ndim - kept :]))

        def item(index: int) -> SurfaceSamples:
            return merged._map(lambda value, kept: value[index])

        return tuple(map(item, range(len(merged.points))))

    def at(self, index: Tensor) -> SurfaceSamples:
        """Some of the samples (N, 3): those with the given indices (M,)."""
        return self._map(lambda value, kept: value[index])

    def flat(self) -> SurfaceSamples:
        """The same samples with the batch dimensions merged into one list of points."""

        return self._map(lambda value, kept: value.reshape(-1, *value.shape[value.ndim - kept :]))

    def _map(self, change: Callable[[Tensor, int], Tensor]) -> SurfaceSamples:
        """The samples with every tensor changed; the function also gets how many axes belong to one sample."""

        def changed(value: Tensor | None, kept: int) -> Tensor | None:
            return None if value is None else change(value, kept)

        return SurfaceSamples(
            change(self.points, 1),
            changed(self.normals, 1),
            changed(self.frames, 2),
            changed(self.areas, 0),
            self.oriented,
        )


def largest_coordinate(dtype: torch.dtype) -> float:
    """The limit of coordinates in this type: squares of distances stay finite below it."""
    return float(torch.finfo(dtype).max) ** 0.5 / 8  # a distance is at most 2√3 times as large


def enough_neighbors(n_neighbors: object) -> None:
    """Check the number of neighbors.

    Raises:
        InputError: if it is not an integer of at least 3.
    """
    if not isinstance(n_neighbors, Integral) or isinstance(n_neighbors, bool) or n_neighbors < 3:
        raise InputError(f"n_neighbors is {n_neighbors!r}; an integer of at least 3 is needed to span a tangent plane.")


def enough_samples(samples: SurfaceSamples, n_neighbors: int, name: str) -> SurfaceSamples:
    """The samples themselves.

    Raises:
        InputError: if they are something else, or do not outnumber the neighbors of each.
    """
    if not isinstance(samples, SurfaceSamples):
        raise InputError(f"samples must be a SurfaceSamples, got {type(samples).__name__}.")
    enough_neighbors(n_neighbors)
    if samples.n_points <= n_neighbors:
        raise InputError(
            f"{name} has {samples.n_points} points, too few for {n_neighbors} neighbors each: "
            f"give at least {n_neighbors + 1}, or pass a smaller n_neighbors (3 or more)."
        )
    return samples


def _check_extent(points: Tensor) -> None:
    """Refuse coordinates, and distances between neighbors, whose squares the type cannot hold; half types are skipped.

    Points that all coincide have no distance, and pass.
    """
    if points.dtype not in (torch.float32, torch.float64) or not points.numel():
        return
    advice = "Divide them by their size" + (", or use float64." if points.dtype == torch.float32 else ".")
    largest = float(points.abs().amax())
    if largest > largest_coordinate(points.dtype):
        raise InputError(f"the points have coordinates up to {largest:g}, whose squares leave {points.dtype}. {advice}")
    extents = (points.amax(-2) - points.amin(-2)).amax(-1)
    smallest = float(torch.where(extents > 0, extents, torch.inf).min())
    if smallest < (float(torch.finfo(points.dtype).tiny) * points.shape[-2]) ** 0.5:
        raise InputError(
            f"the points span only {smallest:g}, and the squares of their distances leave {points.dtype}. {advice}"
        )


def _check(value: object, name: str) -> None:
    if not isinstance(value, Tensor):
        raise InputError(
            f"{name} must be a torch.Tensor, got {type(value).__name__}. Use topokit.from_points for arrays."
        )
    if not value.is_floating_point():
        raise InputError(
            f"{name} must be a floating-point tensor, got {value.dtype}: call .double() or .float() on it."
        )
    if not bool(torch.isfinite(value).all()):
        bad = int((~torch.isfinite(value)).sum())
        raise InputError(f"{name} holds {bad} values that are NaN or infinite; remove those rows first.")
