"""A look at all points of a cloud of moderate size; where votes differ, a second one at shifted or smoothed samples."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.delaunay_cut import DelaunayComplex, delaunay_complex
from topokit.core.cloud.findings import Signs, SignSource
from topokit.core.cloud.look import Cloud, Look
from topokit.core.cloud.neighborhoods import LocalGeometry, compatible_areas, flatten, local_geometry
from topokit.core.cloud.orientation import INTERPOLATING, Orientation, check_normals, orient_samples
from topokit.core.cloud.planes import turned_towards
from topokit.core.cloud.votes import gather_votes, tally
from topokit.core.cloud.widening import Widening, widened
from topokit.core.cloud.wires import WireReading
from topokit.core.progress import begin, stages

Floats = NDArray[np.float64]

SOURCES: dict[str, SignSource] = {"outward": "given", "inward": "reversed", "mixed": "contradictory"}
"""Where outward directions come from, by the kind that given normals turn out to be."""


def look_at_all(cloud: Cloud, wire: WireReading | None) -> Look:
    """A look at all points; where the votes differ, also at shifted or, with noise, at smoothed ones.

    Args:
        cloud: of moderate size.
        wire: the reading of the same points as a thickened graph, or None.
    """
    look, local, found = _look_once(cloud, wire)
    if wire is not None or tally(look.votes)[1] == 1:
        return look
    if found is None or found.coverage >= INTERPOLATING:
        return _with_more_room(look, local, found, cloud.normals)
    return _with_less_noise(look, local, cloud.normals)


def _look_once(cloud: Cloud, wire: WireReading | None) -> tuple[Look, LocalGeometry, Orientation | None]:
    local = local_geometry(cloud.points, cloud.areas)
    begin("orientation")
    signs, outward, complex_, found = _outward(cloud, local, wire)
    turned = time.perf_counter()
    begin("counting")
    weights = compatible_areas(outward, local) if cloud.areas is None else local.areas
    votes, quality, cut = gather_votes(cloud.points, outward, local, weights, complex_)
    spacing = float(np.sqrt(weights.mean()))
    every = np.arange(len(cloud.points))
    look = Look(signs, outward, votes, quality, cut, complex_, every, cloud.points, spacing, spacing, turned, wire)
    return look, local, found


def _with_less_noise(look: Look, local: LocalGeometry, axes: Floats | None) -> Look:
    """The same with the votes of smoothed samples, whose normals are found anew; the quality stays that of the points.

    The votes of both count. The surface is that of the samples whose votes alone give the integer.
    """
    with stages({}):  # nobody is told again of the same stages
        again, _, _ = _look_once(Cloud(flatten(look.points, look.normals, local), axes, None, oriented=False), None)
    votes = look.votes + again.votes
    shown = look if tally(look.votes)[0] == tally(votes)[0] else again
    return replace(look, votes=votes, cut=shown.cut, complex_=shown.complex_, normals=shown.normals, is_repeated=True)


def _with_more_room(look: Look, local: LocalGeometry, found: Orientation | None, axes: Floats | None) -> Look:
    """The same, or with the votes of shifted samples; the quality stays that of the points."""
    best = widened_look(look, local, found, axes)
    if not (best.is_shifted or found):
        return look
    areas = compatible_areas(best.normals, best.local)
    votes, _, cut = gather_votes(best.points, best.normals, best.local, areas, best.complex_, best.cuts)
    votes += best.others if found else ()
    return replace(look, votes=votes, cut=cut, complex_=best.complex_, is_widened=best.is_shifted)


def widened_look(look: Look, local: LocalGeometry, found: Orientation | None, axes: Floats | None) -> Widening:
    """The positions that show the surface best, from given normals or from those of an orientation."""
    if found is None:
        return widened(look.points, look.normals[look.kept], local, look.complex_, look.cut, are_found=False)
    normals, cut = found.corrected(axes)
    return widened(look.points, normals, local, look.complex_, cut, are_found=True, axes=axes)


def _outward(
    cloud: Cloud, local: LocalGeometry, wire: WireReading | None
) -> tuple[Signs, Floats, DelaunayComplex, Orientation | None]:
    """Outward normals (N, 3), where their signs came from, and the tetrahedra and the orientation found on the way."""
    given, source, confirmed = cloud.normals, cloud.unsigned_source, None
    if given is not None and cloud.oriented:
        complex_ = delaunay_complex(cloud.points, local.spacings)
        kind, confirmed = check_normals(cloud.points, given, compatible_areas(given, local), local, complex_)
        source = SOURCES[kind]
        signs = Signs(source, confirmed, None)
        outward = signs.apply(given)
        if outward is not None:
            return signs, outward, complex_, None
    if wire is not None:
        outward = wire.normals if given is None else turned_towards(given, wire.normals)
        return Signs(source, confirmed, None), outward, delaunay_complex(cloud.points, local.spacings), None
    found = orient_samples(cloud.points, local)
    outward = found.normals if given is None else turned_towards(given, found.normals)
    return Signs(source, confirmed, found.coverage), outward, found.complex_, found
