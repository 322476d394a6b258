"""Whether given normals point outward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from topokit.core.arrays import Floats
from topokit.core.cloud.normals.dipoles import border_mean
from topokit.core.cloud.orientation import Orientation, Trial
from topokit.core.cloud.settings import CloudSettings
from topokit.core.cloud.solid.tetrahedra import DelaunayComplex, cut_complex
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import winding_field

SignSource = Literal["given", "reversed", "contradictory", "axes", "none"]


@dataclass(frozen=True)
class Signs:
    """Where the outward directions came from.

    Attributes:
        source: "given" (as they came), "reversed" (they all pointed inward), "contradictory" (they disagreed, so signs
            were found), "axes" (given without signs), "none" (no normals were given).
        confirmed: share of the given normals that the points confirm, or None where signs were not given.
        coverage: share of the samples on the surface that the found directions imply, or None where none were found.
    """

    source: SignSource
    confirmed: float | None
    coverage: float | None

    def apply(self, given: Floats | None) -> Floats | None:
        """Given normals turned outward as a whole; None if their signs had to be found one by one."""
        if given is None or self.source not in ("given", "reversed"):
            return None
        return given if self.source == "given" else -given


def consistent_signs(
    points: Floats, normals: Floats, areas: Floats, spacing: float, settings: CloudSettings
) -> Signs | None:
    """Where the signs come from if the normals all point outward or all inward, by their field; None if they do not.

    The winding-number field of consistent outward normals is high inside, low at the box's faces, near one half at
    every sample, and falls along every normal.

    Args:
        points: (N, 3), centered.
        normals: (N, 3), unit.
        areas: (N,).
        spacing: typical distance between points.
        settings: of the grid and the limits.
    """
    p, n, a = (torch.as_tensor(values, dtype=torch.float32) for values in (points, normals, areas))
    cells, sigma, most = settings.fields.grids[0]
    field = winding_field(p, n, a, make_grid(p, spacing, cells, most, minimum_length=48), sigma)
    confirmed = float(((field.gradient(p) * n).sum(1) < 0).double().mean())
    residual = float((field.sample(p) - 0.5).abs().mean())
    own = settings.given
    if confirmed < own.consistent or residual > own.largest_residual:
        return None
    is_outward = float(field.values.mean()) > float(border_mean(field.values))
    return Signs("given" if is_outward else "reversed", confirmed, None)


def compared_signs(normals: Floats, found: Orientation, complex_: DelaunayComplex, settings: CloudSettings) -> Signs:
    """Where the signs come from, by comparison with an orientation that was found without them.

    The given signs are kept unless the found ones show a surface and imply a clearly cheaper solid: where sheets are
    thin, finding signs is hard. Kept ones are reversed if they enclose a negative volume.

    Args:
        normals: (M, 3), unit, of the samples.
        found: their orientation.
        complex_: their tetrahedra.
        settings: of the limits.
    """
    own, agreement = settings.given, float(((found.normals * normals).sum(1) > 0).mean())
    if 1 - own.consistent < agreement < own.consistent:
        volume = (complex_.spacing**2 * (normals * complex_.points).sum(1)).sum()
        sign = 1.0 if volume > 0 else -1.0
        kept, other = (
            Trial(one, cut_complex(complex_, one, settings.cuts.first)) for one in (sign * normals, found.normals)
        )
        if other.cut.coverage > settings.orientation.hidden and other.cost() < own.cheaper * kept.cost():
            return Signs("contradictory", max(agreement, 1 - agreement), found.coverage)
    else:
        sign = 1.0 if agreement > 0.5 else -1.0
    return Signs("given" if sign > 0 else "reversed", max(agreement, 1 - agreement), None)
