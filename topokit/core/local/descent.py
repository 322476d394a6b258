"""Steps that change samples so that their Gauss–Bonnet sum approaches a target (paper, Section II-C)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor

from topokit.core.linalg import normalize
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import merged_neighbors
from topokit.core.samples import SurfaceSamples

Variable = Literal["normals", "points", "areas"]
Changes = dict[Variable, Tensor]

_TRIALS = 6  # lengths tried along one Polyak step
_LARGEST_CHANGE = 0.3  # root mean square over the samples per step; radians, spacings or shares of an area


def integrity_well(values: Tensor) -> Tensor:
    """Integrity-well loss w_int(x) = (sin(πx − π/2) + 1)²: 0 at even integers, 4 at odd ones.

    Its gradient pulls a value towards the nearest even integer, which closed orientable surfaces have as their Euler
    characteristic. It is a well around each of them: a value never leaves one for the next.

    Args:
        values: Euler characteristics, any shape.

    Returns:
        The loss of each value, of the same shape; differentiable.

    Reference:
        Paper, Section II-C, integrity-well loss.
    """
    return (torch.sin(math.pi * values - math.pi / 2) + 1).square()


@dataclass(frozen=True, eq=False)
class Trial:
    """Samples and how near they come to a goal.

    Attributes:
        samples: (..., N, 3).
        value: their χ, (...).
        error: largest |χ − χ*| over the batch, 0-d on the device of the samples, without synchronization.
    """

    samples: SurfaceSamples
    value: Tensor
    error: Tensor


def either(condition: Tensor, first: Trial, second: Trial) -> Trial:
    """The first trial where a 0-d condition is true, else the second, without synchronization with the host."""

    def chosen(one: Tensor | None, other: Tensor | None) -> Tensor | None:
        return None if one is None or other is None else torch.where(condition, one, other)

    samples = replace(
        first.samples,
        points=torch.where(condition, first.samples.points, second.samples.points),
        normals=chosen(first.samples.normals, second.samples.normals),
        areas=chosen(first.samples.areas, second.samples.areas),
    )
    value, error = (
        torch.where(condition, *both) for both in ((first.value, second.value), (first.error, second.error))
    )
    return Trial(samples, value, error)


class Descent:
    """χ as a function of changes to samples, and steps that bring it closer to a goal.

    Normals change in radians, positions in sample spacings and areas in shares of themselves, so that one step can
    change them together.
    """

    def __init__(
        self,
        neighbors: Tensor,
        settings: CurvatureSettings,
        over: tuple[Variable, ...],
        goal: Tensor,
        points: Tensor,
    ) -> None:
        """
        Args:
            neighbors: (..., N, k) indices, fixed throughout.
            settings: of the curvature estimate.
            over: what may change.
            goal: the wanted χ, (...).
            points: (..., N, 3), for the spacing.
        """
        self.neighbors = neighbors
        self.settings = settings
        self.over = over
        self.goal = goal
        self.spacing = _spacing(points, neighbors)

    def euler(self, samples: SurfaceSamples) -> Tensor:
        local = surface_curvature(samples, self.settings, neighbors=self.neighbors)
        return euler_characteristic(local.gaussian, local.area)

    def trial(self, samples: SurfaceSamples, value: Tensor) -> Trial:
        """Samples with their known χ (...)."""
        return Trial(samples, value, (value - self.goal).abs().max())

    def moved(self, samples: SurfaceSamples, changes: Changes) -> SurfaceSamples:
        points, normals, areas = samples.points, samples.normals, samples.areas
        if "points" in changes:
            points = points + self.spacing * changes["points"]
        if "normals" in changes and normals is not None:
            along = (changes["normals"] * normals).sum(-1, keepdim=True) * normals
            normals = normalize(normals + changes["normals"] - along)
        if "areas" in changes and areas is not None:
            areas = areas * changes["areas"].exp()
        return replace(samples, points=points, normals=normals, areas=areas)

    def gradient_step(self, start: Trial, learning_rate: float) -> Trial:
        """One step of descent of |χ − χ*| + w_int(χ)."""
        value, gradients = self._gradients(start.samples)
        value.requires_grad_()
        with torch.enable_grad():
            loss = ((value - self.goal).abs() + integrity_well(value)).sum()
        (slope,) = torch.autograd.grad(loss, value)
        return self._tried(self.moved(start.samples, self._downhill(gradients, learning_rate * slope)))

    def polyak_step(self, start: Trial, tolerance: float, *, looks: bool) -> Trial:
        """One step by (χ − χ*) ∇χ/|∇χ|²; its length is corrected by secants where χ is not linear along it.

        Args:
            start: where the step begins.
            tolerance: |χ − χ*| that ends the search.
            looks: whether to look after each trial if it has ended, which saves the others; the result is the same.

        Returns:
            The best of the trials.
        """
        samples, error = start.samples, start.value - self.goal
        _, gradients = self._gradients(samples)
        squares = [gradient.square().flatten(self.goal.ndim).sum(-1) for gradient in gradients.values()]
        size = torch.stack(squares).sum(0).clamp(min=torch.finfo(self.goal.dtype).tiny)
        changes = self._downhill(gradients, error / size)
        length, last_length, last_error = torch.ones_like(size), torch.zeros_like(size), error
        best = found = self._tried(self.moved(samples, changes))
        for _ in range(_TRIALS - 1):
            goes_on = ~(found.error < tolerance)
            if looks and not goes_on:
                break
            error = found.value - self.goal
            rise = error - last_error
            is_steady = rise.abs() > torch.finfo(size.dtype).eps * (1 + error.abs())
            secant = length - error * (length - last_length) / torch.where(is_steady, rise, 1)
            last_length, last_error = length, error
            length = torch.where(is_steady, secant.clamp(0.1, 3.0), length)
            scaled: Changes = {name: _like(length, change) * change for name, change in changes.items()}
            tried = self._tried(self.moved(samples, scaled))
            found = either(goes_on, tried, found)
            best = either(found.error < best.error, found, best)
        return best

    def _tried(self, samples: SurfaceSamples) -> Trial:
        return self.trial(samples, self._detached_euler(samples))

    @torch.no_grad()
    def _detached_euler(self, samples: SurfaceSamples) -> Tensor:
        return self.euler(samples)

    def _gradients(self, samples: SurfaceSamples) -> tuple[Tensor, Changes]:
        """χ (...), detached, and its derivative by each variable."""
        points = samples.points
        zeros = {name: torch.zeros_like(points[..., 0] if name == "areas" else points) for name in self.over}
        changes: Changes = {name: zero.requires_grad_() for name, zero in zeros.items()}
        with torch.enable_grad():
            value = self.euler(self.moved(samples, changes))
            total = value.sum()
        gradients = torch.autograd.grad(total, list(changes.values()))
        return value.detach(), dict(zip(changes, gradients, strict=True))

    def _downhill(self, gradients: Changes, rate: Tensor) -> Changes:
        """−rate · gradient, shortened so that typical samples change by no more than `_LARGEST_CHANGE`."""
        changes: Changes = {}
        for name, gradient in gradients.items():
            change = -_like(rate, gradient) * gradient
            typical = change.square().flatten(self.goal.ndim).mean(-1).sqrt()
            changes[name] = change * _like(_LARGEST_CHANGE / typical.clamp(min=_LARGEST_CHANGE), change)
        return changes


def _spacing(points: Tensor, neighbors: Tensor) -> Tensor:
    """Typical sample spacing per batch item, (..., 1, 1), from the mean distance d of k neighbors: 1.5 d / √(k/π).

    For evenly spread samples d is 2/3 of the radius of a disc that holds k of them.
    """
    flat = points.reshape(-1, 3)
    distances = (flat[merged_neighbors(neighbors)] - flat[:, None]).norm(dim=-1)
    mean = distances.mean(-1).reshape(points.shape[:-1]).median(dim=-1).values
    spacing = 1.5 * mean / math.sqrt(neighbors.shape[-1] / math.pi)
    return torch.where(spacing > 0, spacing, 1)[..., None, None]


def _like(values: Tensor, other: Tensor) -> Tensor:
    """(...) reshaped to broadcast against (..., N) or (..., N, 3)."""
    return values.reshape(values.shape + (1,) * (other.ndim - values.ndim))
