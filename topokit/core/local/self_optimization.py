"""Self-optimization: samples adjusted until their Gauss–Bonnet sum equals the target integer (paper, Section II-C)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal, get_args

import torch
from torch import Tensor

from topokit.core.linalg import normalize
from topokit.core.local.curvature import DEFAULT_SETTINGS, CurvatureSettings, surface_curvature
from topokit.core.local.descent import Changes, Descent, Variable
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import nearest_neighbors
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

    Attributes:
        samples: the adjusted samples (detached), with normals and, if they were a variable, areas.
        corrections: by variable, what was added to it: normals and points (..., N, 3); areas (..., N) as a factor.
        history: χ before the first step and after each, (K + 1, ...).
        target: the wanted χ, (...).
        error: largest |χ − χ*| of `samples`, over the batch.
        outcome: why it stopped.
        mean_turn: mean angle by which normals were turned, in radians.
    """

    samples: SurfaceSamples
    corrections: dict[Variable, Tensor]
    history: Tensor
    target: Tensor
    error: float
    outcome: Outcome
    mean_turn: float

    @property
    def steps(self) -> int:
        """Number of steps K."""
        return len(self.history) - 1

    @property
    def converged(self) -> bool:
        """Whether `samples` meet the target within the tolerance."""
        return self.outcome is Outcome.REACHED

    @property
    def reason(self) -> str:
        """Why it stopped, as a sentence."""
        return self.outcome.value.format(error=self.error, steps=self.steps)


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
        neighbors: (..., N, k) indices if they are known; they stay fixed throughout.

    Returns:
        `Refinement`, outside the autograd graph: the corrections are constants for whoever differentiates the result.

    Raises:
        InputError: for an unknown variable or step.

    Note:
        Only one number is corrected, so a better sum does not imply better normals; docs/self-optimization.md has
        measurements.
    """
    if not over or set(over) - set(get_args(Variable)):
        raise InputError(f"over must name some of 'normals', 'points', 'areas'; got {list(over)!r}.")
    if step not in MAX_STEPS:
        raise InputError(f"step {step!r} is unknown; use 'polyak' or 'gradient'.")
    if neighbors is None:
        neighbors = nearest_neighbors(samples.points, settings.n_neighbors)
    neighbors = neighbors.clone() if neighbors.is_inference() else neighbors
    start, value = _start(samples, neighbors, settings, over)
    goal = (
        2 * (value / 2).round()
        if target is None
        else torch.as_tensor(target).detach().to(value).clone().expand_as(value)
    )
    descent = Descent(neighbors, settings, tuple(over), goal, start.points)
    current, history = start, [value]
    best = (descent.error(value), start)
    while best[0] >= tolerance and len(history) <= (MAX_STEPS[step] if max_steps is None else max_steps):
        if step == "polyak":
            current, value = descent.polyak_step(current, value, tolerance)
        else:
            current, value = descent.gradient_step(current, learning_rate)
        history.append(value)
        best = min(best, (descent.error(value), current), key=lambda pair: pair[0])
    error, found = best
    outcome = Outcome.REACHED if error < tolerance else Outcome.OUT_OF_STEPS
    corrections = _corrections(start, found, over)
    return Refinement(found, corrections, torch.stack(history), goal, error, outcome, _mean_turn(start, found))


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


def _mean_turn(before: SurfaceSamples, after: SurfaceSamples) -> float:
    if before.normals is None or after.normals is None:
        return 0.0
    chord = (after.normals - before.normals).norm(dim=-1)
    return float((2 * torch.asin((chord / 2).clamp(max=1))).mean())
