"""Asking the global half of the core about samples, item by item of a batch."""

from __future__ import annotations

import numpy as np
import torch

from topokit.core.cloud.witness import Witness, global_witness
from topokit.core.local.boundary import BoundaryEstimate
from topokit.core.local.curvature import Curvature
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.report.report import Evidence

Answer = Witness | InputError
_CROWDED = 0.05  # share of samples beside another sheet from which curves along thin rims are not taken for a boundary
_OPEN_LENGTH = 60  # spacings of boundary from which the boundary's own sum is believed before a solid's


def is_sheet(boundary: BoundaryEstimate, answer: Answer) -> bool:
    """Whether this is an open surface rather than a solid with faults: long boundary, no opposite sheets nearby."""
    if isinstance(answer, InputError):
        return True
    is_crowded = answer.numbers["crowded"] > _CROWDED
    return not is_crowded and boundary.length > _OPEN_LENGTH * boundary.spacing


def ask_witnesses(samples: SurfaceSamples, boundaries: list[BoundaryEstimate]) -> list[Answer]:
    """The global witness per batch item, or its refusal where the points bound no solid."""
    points = samples.points.detach().reshape(-1, samples.n_points, 3)
    known = samples.known_normals()
    normals = None if known is None else known.detach().reshape(points.shape)
    answers: list[Answer] = []
    for item in range(len(points)):
        own = None if normals is None else normals[item]
        try:
            closed = not boundaries[item].curves
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


def vote_evidence(witness: Witness) -> list[Evidence]:
    """The two families of the global witness, each with the value it gives most often."""
    rows = []
    for name, key in (("Delaunay cuts", "cut"), ("winding-number fields", "grid")):
        values = [value for setting, value in witness.votes.items() if key in setting]
        most = max(values, key=lambda value: (values.count(value), -abs(value)))
        seconds = witness.seconds["votes"] * len(values) / len(witness.votes)
        rows.append(Evidence(name, sum(values) / len(values), most, seconds))
    return rows
