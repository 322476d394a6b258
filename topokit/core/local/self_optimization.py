"""Self-optimization: samples adjusted until their Gauss–Bonnet sum equals the target integer (paper, Section II-C)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from numbers import Integral
from typing import Literal, get_args

import torch
from torch import Tensor

from topokit.core.linalg import normalize
from topokit.core.local.curvature import DEFAULT_SETTINGS, CurvatureSettings, surface_curvature
from topokit.core.local.descent import Changes, Descent, Variable, either
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import nearest_neighbors
from topokit.core.precision import full_precision
from topokit.core.residence import stays_on_device
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError

Step = Literal["polyak", "gradient"]

# |∇χ|² over the normals is 0.05 to 0.35 on spheres, ellipsoids and tori, whatever the number of samples (1 000 to
# 10 000, up to 1 % noise). At this rate a step near the target changes χ by 0.001 to 0.007.
LEARNING_RATE = 0.02
MAX_STEPS: dict[Step, int] = {"polyak": 20, "gradient": 500}


class Outcome(Enum):
    """Why self-optimization stopped."""

    REACHED = "Reached the target to {error:.1e} in {steps} steps."
    OUT_OF_STEPS = "Stopped after {steps} steps, still {error:.3g} from the target."


@dataclass(frozen=True, eq=False)
class Refinement:
    """Result of self-optimization.

    Numbers are read from the device when they are asked for, not before.

    Attributes:
        samples: the adjusted samples (detached), with normals and, if they were a variable, areas.
        corrections: by variable, what was added to it: normals and points (..., N, 3); areas (..., N) as a factor.
        target: the wanted χ, (...).
        tolerance: |χ − χ*| at which to stop.
        values: χ before the first step and after each, (M + 1, ...); after the last of K ≤ M steps it stays as it is.
        count: K, a 0-d tensor.
        distance: largest |χ − χ*| of `samples`, over the batch, a 0-d tensor.
        turn: mean angle by which normals were turned, in radians, a 0-d tensor.
    """

    samples: SurfaceSamples
    corrections: dict[Variable, Tensor]
    target: Tensor
    tolerance: float
    values: Tensor
    count: Tensor
    distance: Tensor
    turn: Tensor

    @property
    def steps(self) -> int:
        """Number of steps K."""
        return int(self.count)

    @property
    def history(self) -> Tensor:
        """χ before the first step and after each, (K + 1, ...)."""
        return self.values[: self.steps + 1]

    @property
    def error(self) -> float:
        """Largest |χ − χ*| of `samples`, over the batch."""
        return float(self.distance)

    @property
    def mean_turn(self) -> float:
        """Mean angle by which normals were turned, in radians."""
        return float(self.turn)

    @property
    def outcome(self) -> Outcome:
        """Why it stopped."""
        return Outcome.REACHED if self.error < self.tolerance else Outcome.OUT_OF_STEPS

    @property
    def converged(self) -> bool:
        """Whether `samples` meet the target within the tolerance."""
        return self.outcome is Outcome.REACHED

    @property
    def reason(self) -> str:
        """Why it stopped, as a sentence."""
        return self.outcome.value.format(error=self.error, steps=self.steps)


@full_precision
@torch.inference_mode(False)
def self_optimize(
    samples: SurfaceSamples,
    target: Tensor | float | None = None,
    *,
    settings: CurvatureSettings = DEFAULT_SETTINGS,
    over: Sequence[Variable] = ("normals",),
    step: Step = "polyak",
    learning_rate: float = LEARNING_RATE,
    max_steps: int | None = None,
    tolerance: float = 1e-3,
    look_every: int | None = None,
    neighbors: Tensor | None = None,
) -> Refinement:
    """Adjust samples until (1/2π) Σ K·A equals the target (Algorithm 2, steps 8 and 9).

    Args:
        samples: the start; normals are estimated if there are none. Nothing is changed in place.
        target: the wanted Euler characteristic, a number or (...); None takes the nearest even integer, which adds no
            information from outside.
        settings: number of neighbors and methods of the curvature estimate.
        over: what may change: normals (and with them the moving frames), points, areas.
        step: "polyak" moves by (χ − χ*) ∇χ/|∇χ|², which solves a linear problem in one step. "gradient" is the paper's
            descent of |χ − χ*| + w_int(χ); beyond the nearest even integer the wells in between hold it back.
        learning_rate: of "gradient", by default for normals alone. Larger rates are faster and stop farther from the
            target, at about rate · |∇χ|². Areas alone need up to N times the rate, because their |∇χ|² falls as 1/N.
        max_steps: largest number of steps; by default 20 for "polyak", 500 (as in the paper) for "gradient".
        tolerance: |χ − χ*| at which to stop.
        look_every: after how many steps the host looks whether the target is met, and ends the optimization. The result
            does not depend on it: once the target is met, further steps change nothing. None looks after each step on
            the CPU, and never on accelerators, where all `max_steps` are computed without a visit to the host.
        neighbors: (..., N, k) indices if they are known; they stay fixed throughout.

    Returns:
        `Refinement`, outside the autograd graph: the corrections are constants in derivatives of the result.

    Raises:
        InputError: for an unknown variable or step, or if look_every is not an integer of at least 1.

    Note:
        Only one number is corrected, so a better sum does not imply better normals; docs/self-optimization.md has
        measurements.
    """
    if not over or set(over) - set(get_args(Variable)):
        raise InputError(f"over must name some of 'normals', 'points', 'areas'; got {list(over)!r}.")
    if step not in MAX_STEPS:
        raise InputError(f"step {step!r} is unknown; use 'polyak' or 'gradient'.")
    if look_every is not None and (not isinstance(look_every, Integral) or look_every < 1):
        raise InputError(f"look_every must be an integer of at least 1, or None, not {look_every!r}.")
    if neighbors is None:
        neighbors = nearest_neighbors(samples.points, settings.n_neighbors)
    neighbors = neighbors.clone() if neighbors.is_inference() else neighbors
    start, value = _start(samples, neighbors, settings, over)
    goal = 2 * (value / 2).round() if target is None else as_goal(target, value)
    descent = Descent(neighbors, settings, tuple(over), goal, start.points)
    best = current = descent.trial(start, value)
    values, count = [value], torch.zeros((), dtype=torch.int64, device=value.device)
    every = 1 if look_every is None and not stays_on_device(value) else look_every
    for number in range(MAX_STEPS[step] if max_steps is None else max_steps):
        goes_on = best.error >= tolerance
        if every is not None and number % every == 0 and not goes_on:
            break
        if step == "polyak":
            moved = descent.polyak_step(current, tolerance, looks=every == 1)
        else:
            moved = descent.gradient_step(current, learning_rate)
        current = either(goes_on, moved, current)
        best = either(current.error < best.error, current, best)
        values.append(current.value)
        count = count + goes_on
    found = best.samples
    turn, corrections = _mean_turn(start, found), _corrections(start, found, over)
    return Refinement(found, corrections, goal, tolerance, torch.stack(values), count, best.error, turn)


def as_goal(target: Tensor | float, like: Tensor) -> Tensor:
    """A target as a tensor like another one, (...); a plain number is not copied to the device: that is a visit."""
    if isinstance(target, int | float):
        return torch.full_like(like, target)
    return torch.as_tensor(target).detach().to(like).clone().expand_as(like)


def corrected(samples: SurfaceSamples, refinement: Refinement, areas: Tensor) -> SurfaceSamples:
    """Samples with the corrections of an earlier refinement added as constants, differentiable in `samples`.

    Args:
        samples: with normals, as many as were refined.
        refinement: what `self_optimize` returned for them.
        areas: (..., N) areas of the samples, which the correction of the areas, if there is one, multiplies.
    """
    changes, normals = refinement.corrections, samples.normals
    if normals is not None and "normals" in changes:
        normals = normalize(normalize(normals) + changes["normals"])
    factors = changes.get("areas")
    points = samples.points + changes["points"] if "points" in changes else samples.points
    return replace(samples, points=points, normals=normals, areas=samples.areas if factors is None else areas * factors)


def _start(
    samples: SurfaceSamples, neighbors: Tensor, settings: CurvatureSettings, over: Sequence[Variable]
) -> tuple[SurfaceSamples, Tensor]:
    """Detached samples that have normals, and areas of their own if those may change; and their χ."""
    with torch.no_grad():
        local = surface_curvature(samples, settings, neighbors=neighbors)
    areas = local.area.detach() if samples.areas is not None or "areas" in over else None
    points = samples.points.detach()
    points = points.clone() if points.is_inference() else points  # those cannot take part in gradients
    start = SurfaceSamples(points, local.normals.detach(), areas=areas, oriented=samples.oriented)
    return start, euler_characteristic(local.gaussian, local.area)


def _corrections(before: SurfaceSamples, after: SurfaceSamples, over: Sequence[Variable]) -> Changes:
    found: Changes = {}
    if "points" in over:
        found["points"] = after.points - before.points
    if "normals" in over and before.normals is not None and after.normals is not None:
        found["normals"] = after.normals - before.normals
    if "areas" in over and before.areas is not None and after.areas is not None:
        found["areas"] = torch.where(before.areas > 0, after.areas / before.areas, 1)
    return found


def _mean_turn(before: SurfaceSamples, after: SurfaceSamples) -> Tensor:
    if before.normals is None or after.normals is None:
        return before.points.new_zeros(())
    chord = (after.normals - before.normals).norm(dim=-1)
    return (2 * torch.asin((chord / 2).clamp(max=1))).mean()
