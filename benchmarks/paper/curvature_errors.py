"""Errors of K and H over all draws, as cells of the tables that correspond to Table I."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median

from torch import Tensor

from benchmarks.paper.baselines import Triangles, vertex_areas
from benchmarks.paper.printed import TABLE_1
from benchmarks.paper.tables import spread
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.testing import AnalyticSamples

HEADER = ["K max", "K mean", "K median", "H max", "H mean", "χ", "CPU s", "paper: K max, mean", "H", "χ"]


@dataclass(frozen=True)
class Found:
    """K and H at every point, with the signs of H right, their integral and the time it took."""

    gaussian: Tensor
    mean: Tensor
    euler: float
    seconds: float


def logs(errors: Tensor) -> tuple[float, float, float]:
    """log₁₀ of maximum, mean and median; values that are not finite count as the largest that are."""
    errors = errors.nan_to_num(nan=1e300, posinf=1e300)
    return tuple(math.log10(max(float(one), 1e-300)) for one in (errors.max(), errors.mean(), errors.median()))  # type: ignore[return-value]


def outward(mean: Tensor, known: AnalyticSamples) -> Tensor:
    """H of a mesh with the sign of the outward normal, whichever way most of its faces are turned."""
    return -mean if (mean * known.mean).median() < 0 else mean


def integral(gaussian: Tensor, mesh: Triangles) -> float:
    """Σ K A/2π over the vertices of a mesh."""
    return float(euler_characteristic(gaussian, vertex_areas(mesh)))


def cells(found: list[tuple[AnalyticSamples, Found]], printed: tuple[str, str] | None) -> list[str]:
    """Errors, χ and seconds of all draws, and what the paper prints in a row and column of Table I."""
    of_gaussian = [logs((one.gaussian - known.gaussian).abs()) for known, one in found]
    of_mean = [logs((one.mean - known.mean).abs()) for known, one in found]
    k_max, k_mean, k_median = zip(*of_gaussian, strict=True)
    h_max, h_mean, _ = zip(*of_mean, strict=True)
    row, column = printed or ("", "")
    paper = TABLE_1.get(row, {}).get(column)
    told = [f"{p:.3f}, {q:.3f}" for p, q in paper[:2]] + [f"{paper[2]:g}"] if paper else ["–"] * 3
    values = (f"{max(k_max):.2f}", spread(k_mean), spread(k_median), f"{max(h_max):.2f}", spread(h_mean))
    seconds = median(one.seconds for _, one in found)
    return [*values, spread([one.euler for _, one in found]), f"{seconds:.2f}", *told]
