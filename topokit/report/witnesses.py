"""Asking the global half of the core about samples, item by item of a batch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from topokit.core.cloud.witness import Witness, global_witness
from topokit.core.local.boundary import BoundaryCurve, boundary_curves, rim_points
from topokit.core.local.curvature import Curvature, surface_curvature
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.report.report import Evidence

Answer = Witness | InputError
_CROWDED = 0.05  # share of samples beside another sheet from which curves along thin rims are not taken for a boundary
_OPEN_LENGTH = 60  # spacings of boundary from which the boundary's own sum is believed before a solid's


@dataclass(frozen=True)
class Ends:
    """Where one batch item ends.

    Attributes:
        curves: boundary curves.
        rim_share: share of samples with neighbours on one side only.
        spacing: typical distance of samples.
    """

    curves: tuple[BoundaryCurve, ...]
    rim_share: float
    spacing: float

    def is_sheet(self, answer: Answer) -> bool:
        """Whether this is an open surface rather than a solid with faults: long boundary, no opposite sheets nearby."""
        if isinstance(answer, InputError):
            return True
        is_crowded = answer.numbers["crowded"] > _CROWDED
        return not is_crowded and sum(curve.length for curve in self.curves) > _OPEN_LENGTH * self.spacing


def ask_witnesses(samples: SurfaceSamples, ends: list[Ends]) -> list[Answer]:
    """The global witness per batch item, or its refusal where the points bound no solid."""
    points = samples.points.detach().reshape(-1, samples.n_points, 3)
    known = samples.known_normals()
    normals = None if known is None else known.detach().reshape(points.shape)
    answers: list[Answer] = []
    for item in range(len(points)):
        own = None if normals is None else normals[item]
        try:
            closed = not ends[item].curves
            answers.append(global_witness(points[item], own, oriented=samples.oriented, may_smooth=closed))
        except InputError as refusal:
            answers.append(refusal)
    return answers


def outward_samples(samples: SurfaceSamples, local: Curvature, answers: list[Answer]) -> SurfaceSamples:
    """The samples with normals, each turned outward where the witness knows the outside; differentiable."""
    heard = [answer for answer in answers if isinstance(answer, Witness)]
    if len(heard) < len(answers):
        return SurfaceSamples(samples.points, local.normals, areas=samples.areas, oriented=False)
    outward = torch.from_numpy(np.stack([witness.normals for witness in heard])).to(local.normals)
    sides = (local.normals.detach() * outward.reshape(local.normals.shape)).sum(-1, keepdim=True)
    sign = torch.where(sides < 0, -1.0, 1.0).to(local.normals)
    return SurfaceSamples(samples.points, sign * local.normals, areas=samples.areas)


def find_ends(samples: SurfaceSamples, local: Curvature) -> list[Ends]:
    """Where the surface ends, per batch item.

    It comes from the geometry of the points alone: given normals of thin parts would hide and feign rims.
    """
    found = []
    n_points = samples.n_points
    for item, points in enumerate(samples.points.detach().reshape(-1, n_points, 3)):
        neighbors = local.neighbors[item * n_points : (item + 1) * n_points] - item * n_points
        with torch.no_grad():
            plain = surface_curvature(SurfaceSamples(points), neighbors=neighbors)
        rim = rim_points(points, plain.normals, neighbors)
        spacing = float(plain.area.mean().sqrt())
        curves = boundary_curves(points, plain.normals, rim, spacing)
        found.append(Ends(curves, float(rim.double().mean()), spacing))
    return found


def vote_evidence(witness: Witness) -> list[Evidence]:
    """The two families of the global witness, each with the value it gives most often."""
    rows = []
    for name, key in (("Delaunay cuts", "cut"), ("winding-number fields", "grid")):
        values = [value for setting, value in witness.votes.items() if key in setting]
        most = max(values, key=lambda value: (values.count(value), -abs(value)))
        seconds = witness.seconds["votes"] * len(values) / len(witness.votes)
        rows.append(Evidence(name, sum(values) / len(values), most, seconds))
    return rows
