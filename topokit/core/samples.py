"""Oriented surface samples: what every representation becomes before the core sees it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

import torch
from torch import Tensor

from topokit.core.residence import stays_on_device
from topokit.errors import InputError, Option

_FEWEST = 9  # points from which fewer neighbors are worth recommending


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Points on a surface, with whatever is already known about the surface there.

    Attributes:
        points: (..., N, 3), any unit of length.
        normals: (..., N, 3) or None (then estimated from local quadrics, or by PCA where that is asked for). Need not
            be unit vectors; must not be zero.
        frames: (..., N, 3, 3) or None; rows t, t', n of an orthonormal moving frame. Takes precedence over `normals`.
        areas: (..., N) or None (then the tangent Voronoi areas), in squared units of length.
        oriented: True if the normals point outward. If False, or if there are no normals, neighboring normals are
            aligned with the center's before they are compared: the Gaussian curvature does not depend on the signs,
            and the sign of the mean curvature is arbitrary.
        lengths: (...) int64, number of points of each batch item, where the rows after them are padding; None if there
            is no padding. Padding may hold anything finite.

    Raises:
        InputError: on wrong shapes, types or devices, and on the CPU for values that are not finite, or points that
            span so much or so little that areas and curvature leave the range of their type. On accelerators the values
            are not checked, which would synchronize with the host: NaN in gives NaN out.
    """

    points: Tensor
    normals: Tensor | None = None
    frames: Tensor | None = None
    areas: Tensor | None = None
    oriented: bool = True
    lengths: Tensor | None = None

    def __post_init__(self) -> None:
        _check(self.points, "points")
        if self.points.ndim < 2 or self.points.shape[-1] != 3:
            raise InputError(f"points must have shape (..., N, 3), got {tuple(self.points.shape)}.")
        if not stays_on_device(self.points):
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
        if self.lengths is not None:
            _check_lengths(self.lengths, self.points)
        if self.normals is None and self.frames is None:
            object.__setattr__(self, "oriented", False)

    def check_finite(self) -> None:
        """Look for values that are not finite, and for distances whose squares are not, on any device.

        Raises:
            InputError: if there are some.
        """
        named = {"points": self.points, "normals": self.normals, "frames": self.frames, "areas": self.areas}
        for name, value in named.items():
            if value is not None:
                _check_finite(value, name)
        _check_extent(self.points.detach())

    @property
    def n_points(self) -> int:
        """Number of points N of each batch item, with padding."""
        return self.points.shape[-2]

    @property
    def requires_grad(self) -> bool:
        """Whether a gradient of the samples is asked for."""
        tensors = (self.points, self.normals, self.frames, self.areas)
        return any(one.requires_grad for one in tensors if one is not None)

    def known_normals(self) -> Tensor | None:
        """Normals (..., N, 3) as given, or the third axis of the frames; None if there are neither."""
        return self.frames[..., 2, :] if self.frames is not None else self.normals

    def to(self, *args: Any, **kwargs: Any) -> SurfaceSamples:
        """The samples on another device or in another floating type; arguments as for `torch.Tensor.to`."""
        moved = self._map(lambda value, kept: value.to(*args, **kwargs))
        return replace(moved, lengths=None if self.lengths is None else self.lengths.to(moved.points.device))

    def versions(self) -> tuple[int, ...]:
        """Counters that change when a tensor is changed in place; tensors of inference mode have none."""
        tensors = (self.points, self.normals, self.frames, self.areas, self.lengths)
        return tuple(0 if one.is_inference() else one._version for one in tensors if one is not None)

    def items(self) -> tuple[SurfaceSamples, ...]:
        """The samples of each batch item, detached, in the order of the merged batch dimensions."""
        return self._map(lambda value, kept: value.detach()).separate()

    def separate(self) -> tuple[SurfaceSamples, ...]:
        """The samples of each batch item without padding, with their graph, in the order of the merged dimensions."""
        n_points = self.n_points
        merged = self._map(lambda value, kept: value.reshape(-1, n_points, *value.shape[value.ndim - kept :]))
        counts = [n_points] * len(merged.points) if self.lengths is None else self.lengths.reshape(-1).tolist()

        def item(index: int, count: int) -> SurfaceSamples:
            return merged._map(lambda value, kept: value[index, :count])

        return tuple(item(*numbered) for numbered in enumerate(counts))

    def without_values_in_padding(self) -> SurfaceSamples:
        """The samples with zeros in rows of padding, so that nothing there has an influence or a gradient."""
        if self.lengths is None:
            return self
        padding = is_padding(self.lengths, self.n_points)
        return self._map(lambda value, kept: value.masked_fill(padding[(...,) + (None,) * kept], 0))

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


def _check_lengths(lengths: object, points: Tensor) -> None:
    if not isinstance(lengths, Tensor) or lengths.dtype != torch.int64 or lengths.device != points.device:
        raise InputError(f"lengths must be an int64 tensor on {points.device}, got {lengths!r}.")
    if lengths.shape != points.shape[:-2]:
        raise InputError(
            f"lengths must have shape {tuple(points.shape[:-2])}, one number for each batch item, got "
            f"{tuple(lengths.shape)}."
        )


def is_padding(lengths: Tensor, n_points: int) -> Tensor:
    """Which rows are padding, (..., N) bool.

    Args:
        lengths: (...) number of points of each batch item.
        n_points: N, rows of each.
    """
    return torch.arange(n_points, device=lengths.device) >= lengths[..., None]


def enough_neighbors(n_neighbors: object) -> None:
    """Check the number of neighbors.

    Raises:
        InputError: if it is not an integer of at least 3.
    """
    if not isinstance(n_neighbors, Integral) or isinstance(n_neighbors, bool) or n_neighbors < 3:
        needed = f" is {n_neighbors!r}; an integer of at least 3 is needed to span a tangent plane."
        raise InputError(Option("n_neighbors"), needed)


def enough_points(n_points: int, n_neighbors: int, name: str) -> None:
    """Check that there are more points than neighbors of each.

    Raises:
        InputError: if there are not; it recommends fewer neighbors only where some points are left to choose from.
    """
    if n_points <= n_neighbors:
        fewer = ", or pass a smaller ", Option("n_neighbors"), f" (3 to {n_points - 1})"
        raise InputError(
            f"{name} has {n_points} point{'' if n_points == 1 else 's'}, too few for {n_neighbors} neighbors each: "
            f"give at least {n_neighbors + 1}",
            *(fewer if n_points >= _FEWEST else ()),
            ".",
        )


def enough_samples(samples: SurfaceSamples, n_neighbors: int, name: str) -> SurfaceSamples:
    """The samples themselves.

    Raises:
        InputError: if they are something else, or do not outnumber the neighbors of each.
    """
    if not isinstance(samples, SurfaceSamples):
        raise InputError(f"samples must be a SurfaceSamples, got {type(samples).__name__}.")
    enough_neighbors(n_neighbors)
    enough_points(samples.n_points, n_neighbors, name)
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
    if not stays_on_device(value):
        _check_finite(value, name)


def _check_finite(value: Tensor, name: str) -> None:
    if not bool(torch.isfinite(value).all()):
        bad = int((~torch.isfinite(value)).sum())
        raise InputError(f"{name} holds {bad} values that are NaN or infinite; remove those rows first.")
