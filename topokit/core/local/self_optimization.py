"""Self-optimisation: samples adjusted until their Gauss–Bonnet sum is the integer it must be (paper, Section II-C)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor

from topokit.core.linalg import normalize
from topokit.core.local.curvature import DEFAULT_SETTINGS, CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import merged_neighbors, nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError

Variable = Literal["normals", "points", "areas"]
Step = Literal["polyak", "gradient"]
_TRIALS = 6  # lengths tried along one Polyak step
_LARGEST_TURN = 0.3  # radians (or spacings, or parts of an area) that one step may change a typical sample by


def integrity_well(values: Tensor) -> Tensor:
    """w_int(x) = (sin(πx − π/2) + 1)²: zero at even integers, 4 at odd ones.

    Args:
        values: any shape.

    Reference:
        Paper, Section II-C, integrity-well loss.
    """
    return (torch.sin(math.pi * values - math.pi / 2) + 1).square()


@dataclass(frozen=True, eq=False)
class Refinement:
    """What self-optimisation did.

    Attributes:
        samples: the adjusted samples (detached), with normals and, if they were a variable, areas.
        corrections: by variable, what was added to it: normals and points (..., N, 3), areas (..., N) as a factor.
        history: χ before the first step and after each, (K + 1, ...).
        target: what χ was to become, (...).
        steps: number of steps K.
        reason: why it stopped, as a sentence.
        mean_turn: mean angle by which normals were turned, in radians.
    """

    samples: SurfaceSamples
    corrections: dict[str, Tensor]
    history: Tensor
    target: Tensor
    steps: int
    reason: str
    mean_turn: float

    @property
    def converged(self) -> bool:
        """Whether the last value is the target to the tolerance that was asked for."""
        return self.reason.startswith("Reached")


def self_optimize(
    samples: SurfaceSamples,
    target: Tensor | float | None = None,
    *,
    settings: CurvatureSettings = DEFAULT_SETTINGS,
    over: Sequence[Variable] = ("normals",),
    step: Step = "polyak",
    learning_rate: float = 1e-3,
    max_steps: int = 20,
    tolerance: float = 1e-3,
    neighbors: Tensor | None = None,
) -> Refinement:
    """Adjust samples until (1/2π) Σ K·A is the target (Algorithm 2, steps 8 and 9).

    Args:
        samples: where to start; normals are estimated if there are none. Nothing is changed in place.
        target: the Euler characteristic that is wanted, a number or (...); None takes the nearest even integer, which
            adds no information from outside.
        settings: number of neighbors and methods of the curvature estimate.
        over: what may change: normals (and with them the moving frames), points, areas.
        step: "polyak" moves by (χ − χ*) ∇χ/|∇χ|², which a function linear in the step answers at once; "gradient"
            is the paper's descent of |χ − χ*| + w_int(χ) with `learning_rate`.
        learning_rate: of "gradient"; "polyak" has none.
        max_steps: K at most.
        tolerance: |χ − χ*| at which to stop.
        neighbors: (..., N, k) indices if they are known; they stay fixed throughout.

    Returns:
        `Refinement`. Outside the autograd graph: the corrections are constants for whoever differentiates the result.

    Raises:
        InputError: for an unknown variable or step.

    Note:
        The normals' errors are not measured here, only one number's: a better sum need not mean better normals.
        docs/self-optimisation.md tells what it does to them.
    """
    unknown = set(over) - {"normals", "points", "areas"}
    if unknown or not over:
        raise InputError(f"over must name some of 'normals', 'points', 'areas'; got {list(over)!r}.")
    if step not in ("polyak", "gradient"):
        raise InputError(f"step {step!r} is not known; use 'polyak' or 'gradient'.")
    neighbors = nearest_neighbors(samples.points, settings.n_neighbors) if neighbors is None else neighbors
    samples = _start(samples, neighbors, settings, over)
    unit = _units(samples, neighbors)
    value = _euler(samples, neighbors, settings)
    goal = 2 * (value / 2).round() if target is None else torch.as_tensor(target).to(value).expand_as(value)
    first, history = samples, [value]
    best = (float((value - goal).abs().max()), samples)
    while best[0] >= tolerance and len(history) <= max_steps:
        direction = _direction(samples, over, unit, goal, neighbors, settings, step, learning_rate)
        trials = _TRIALS if step == "polyak" else 1
        samples, value = _line_search(
            samples, direction, history[-1] - goal, unit, goal, neighbors, settings, tolerance, trials
        )
        history.append(value)
        best = min(best, (float((value - goal).abs().max()), samples), key=lambda pair: pair[0])
    off, samples = best
    n_steps = len(history) - 1
    if off < tolerance:
        reason = f"Reached the target to {off:.1e} in {n_steps} steps."
    else:
        reason = f"Stopped after {n_steps} steps, still {off:.3g} from the target."
    return Refinement(
        samples, _corrections(first, samples, over), torch.stack(history), goal, n_steps, reason, _turn(first, samples)
    )


def corrected(samples: SurfaceSamples, refinement: Refinement) -> SurfaceSamples:
    """Samples with the corrections of an earlier refinement added as constants, differentiable in `samples`.

    Args:
        samples: with normals, as many as were refined.
        refinement: what `self_optimize` returned for them.
    """
    changes = refinement.corrections
    normals, areas = samples.normals, samples.areas
    if normals is not None and "normals" in changes:
        normals = normalize(normalize(normals) + changes["normals"])
    if areas is not None and "areas" in changes:
        areas = areas * changes["areas"]
    points = samples.points + changes["points"] if "points" in changes else samples.points
    return SurfaceSamples(points, normals, areas=areas, oriented=samples.oriented)


def _start(
    samples: SurfaceSamples, neighbors: Tensor, settings: CurvatureSettings, over: Sequence[Variable]
) -> SurfaceSamples:
    """Detached samples that have normals, and areas of their own if those may change."""
    with torch.no_grad():
        local = surface_curvature(samples, settings, neighbors=neighbors)
    areas = local.area if samples.areas is not None or "areas" in over else None
    return SurfaceSamples(
        samples.points.detach(),
        local.normals.detach(),
        areas=None if areas is None else areas.detach(),
        oriented=samples.oriented,
    )


def _units(samples: SurfaceSamples, neighbors: Tensor) -> Tensor:
    """Typical sample spacing per batch item, (..., 1, 1): a step of one spacing counts like a turn of one radian."""
    flat = samples.points.reshape(-1, 3)
    nearest = (
        (flat[merged_neighbors(neighbors)] - flat[:, None]).norm(dim=-1).mean(-1).reshape(samples.points.shape[:-1])
    )
    spacing = nearest.median(dim=-1).values / math.sqrt(neighbors.shape[-1] / math.pi) * 1.5
    return torch.where(spacing > 0, spacing, 1)[..., None, None]


def _euler(samples: SurfaceSamples, neighbors: Tensor, settings: CurvatureSettings) -> Tensor:
    with torch.no_grad():
        local = surface_curvature(samples, settings, neighbors=neighbors)
        return euler_characteristic(local.gaussian, local.area)


def _direction(
    samples: SurfaceSamples,
    over: Sequence[Variable],
    unit: Tensor,
    goal: Tensor,
    neighbors: Tensor,
    settings: CurvatureSettings,
    step: Step,
    learning_rate: float,
) -> dict[Variable, Tensor]:
    """One step, in radians, spacings and parts of an area, so that the variables can share it."""
    changes = {name: _zero(samples, name).requires_grad_() for name in over}
    with torch.enable_grad():
        trial = _apply(samples, changes, unit)
        local = surface_curvature(trial, settings, neighbors=neighbors)
        value = euler_characteristic(local.gaussian, local.area)
        if step == "polyak":
            objective, rate = value.sum(), value.detach() - goal
        else:
            objective = ((value - goal).abs() + integrity_well(value)).sum()
            rate = torch.full_like(goal, learning_rate)
        gradients = torch.autograd.grad(objective, list(changes.values()))
    if step == "polyak":
        size = torch.stack([gradient.square().flatten(goal.ndim).sum(-1) for gradient in gradients]).sum(0)
        rate = rate / size.clamp(min=torch.finfo(goal.dtype).tiny)
    moves: dict[Variable, Tensor] = {}
    for name, gradient in zip(changes, gradients, strict=True):
        move = -_like(rate, gradient) * gradient
        typical = move.square().flatten(goal.ndim).mean(-1).sqrt()
        moves[name] = move * _like(_LARGEST_TURN / typical.clamp(min=_LARGEST_TURN), move)
    return moves


@torch.no_grad()
def _line_search(
    samples: SurfaceSamples,
    direction: dict[Variable, Tensor],
    error: Tensor,
    unit: Tensor,
    goal: Tensor,
    neighbors: Tensor,
    settings: CurvatureSettings,
    tolerance: float,
    trials: int,
) -> tuple[SurfaceSamples, Tensor]:
    """The step, its length corrected by secants where the sum did not follow its derivative; the best trial counts."""
    length, before, was = torch.ones_like(goal), torch.zeros_like(goal), error
    best = (samples, goal + torch.inf)
    for _ in range(trials):
        moved = _apply(samples, {name: _like(length, move) * move for name, move in direction.items()}, unit)
        value = _euler(moved, neighbors, settings)
        if float((value - goal).abs().max()) < float((best[1] - goal).abs().max()):
            best = (moved, value)
        if float((best[1] - goal).abs().max()) < tolerance:
            break
        now = value - goal
        slope = now - was
        steady = slope.abs() > torch.finfo(goal.dtype).eps * (1 + now.abs())
        follow = length - now * (length - before) / torch.where(steady, slope, 1)
        before, was, length = length, now, torch.where(steady, follow.clamp(0.1, 3.0), length)
    return best


def _like(values: Tensor, other: Tensor) -> Tensor:
    """(...) reshaped to broadcast against (..., N) or (..., N, 3)."""
    return values.reshape(values.shape + (1,) * (other.ndim - values.ndim))


def _zero(samples: SurfaceSamples, name: str) -> Tensor:
    return torch.zeros_like(samples.points if name != "areas" else samples.points[..., 0])


def _apply(samples: SurfaceSamples, changes: dict[Variable, Tensor], unit: Tensor) -> SurfaceSamples:
    points, normals, areas = samples.points, samples.normals, samples.areas
    if "points" in changes:
        points = points + unit * changes["points"]
    if "normals" in changes and normals is not None:
        along = (changes["normals"] * normals).sum(-1, keepdim=True) * normals
        normals = normalize(normals + changes["normals"] - along)
    if "areas" in changes and areas is not None:
        areas = areas * changes["areas"].exp()
    return replace(samples, points=points, normals=normals, areas=areas)


def _corrections(before: SurfaceSamples, after: SurfaceSamples, over: Sequence[Variable]) -> dict[str, Tensor]:
    found: dict[str, Tensor] = {}
    if "points" in over:
        found["points"] = after.points - before.points
    if "normals" in over and before.normals is not None and after.normals is not None:
        found["normals"] = after.normals - before.normals
    if "areas" in over and before.areas is not None and after.areas is not None:
        found["areas"] = torch.where(before.areas > 0, after.areas / before.areas, 1)
    return found


def _turn(before: SurfaceSamples, after: SurfaceSamples) -> float:
    if before.normals is None or after.normals is None:
        return 0.0
    chord = (after.normals - before.normals).norm(dim=-1)
    return float((2 * torch.asin((chord / 2).clamp(max=1))).mean())
