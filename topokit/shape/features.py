"""Widths of a shape: its features, and the places so narrow that little would change what is counted."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch

from topokit.core.cloud.votes import share_of
from topokit.core.mesh.topology import mesh_topology
from topokit.core.scale.features import CELLS_PER_WIDTH, SolidFeatures, solid_features
from topokit.core.scale.narrow_places import NarrowPlace, missed_places
from topokit.core.scale.narrow_places import narrow_places as places_in
from topokit.core.scale.signed_distance import signed_distance
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError, TopokitError
from topokit.report.advice import is_noisy
from topokit.report.report import TopologyReport, known_euler
from topokit.shape.surface import closed_surface, found_surface

if TYPE_CHECKING:
    from topokit.shape.shape import Shape

_CELLS_WITHIN = 6  # across the narrowest features if their width is given: a limit that someone asks about
_ERROR = 0.5  # cells by which the widths of 160 planted features were wrong, 98 of 100 by less
_CELLS = 128  # along the longest side of the first grid, if no width is asked for
_CELLS_BELOW = 6  # across the largest width of narrow places
_MOST_VERTICES = 1 << 23  # of a grid: about 8 s and 1.2 GB


def features(shape: Shape, finest: float | None = None) -> SolidFeatures:
    """The parts, tunnels and cavities of the solid inside the closed surface, each with its width and place.

    The width of a feature is the diameter of the largest ball that moves along it inside the solid, or of the largest
    that fits through it outside, whichever is smaller. Widths come from persistent homology of the signed distance on
    a grid; in tests with planted features their median error is 2 %. Not differentiable.

    Args:
        finest: width of the narrowest features to look for, in units of length, on a grid with six cells across it, or
            three if that grid would be too fine. Half the width takes eight times as long. By default, with three
            cells, the report's `resolution`, but at least 2.3 % of the longest side of the surface's box;
            where the integer is counted and narrower features add to it, half of that, and so on, down to what the
            largest grid allows.

    Returns:
        `SolidFeatures`: `.features`, narrowest first, and `.above(width)`, which counts those at least so wide.

    Raises:
        InputError: if there is no closed surface (see `surface`), or `finest` is not positive or needs too fine a grid.
        MissingDependencyError: if cripser is not installed.

    Reference:
        Cohen-Steiner, Edelsbrunner and Harer 2007, DOI 10.1007/s00454-006-1276-5 (stability of persistence).

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import torus_mesh
        >>> found = tk.from_mesh(torus_mesh(major=1.0, minor=0.3)).features()
        >>> [tunnel] = [one for one in found.features if one.kind == "tunnel"]
        >>> round(tunnel.thickness, 1), round(tunnel.opening, 1)  # 2 · 0.3 and 2 · (1 − 0.3)
        (0.6, 1.4)
    """
    report, surface = shape.report(), closed_surface(shape)
    sides = np.ptp(surface.vertices, axis=0)
    smallest = CELLS_PER_WIDTH * _smallest_cell(surface)
    if finest is None:
        width = max(report.resolution or 0.0, CELLS_PER_WIDTH * float(sides.max()) / _CELLS)
        found = _features(surface, width, known_euler(report))
        while found.narrower and report.resolution is None and width > smallest:
            width = max(width / 2, smallest)
            found = _features(surface, width, found.euler)
        return found
    if not finest > 0:
        raise InputError(f"finest is {finest!r}; a positive width in units of length was expected.")
    if finest < smallest:
        raise InputError(
            f"{shape.name}: features {finest:.4g} wide need a grid of more than {_MOST_VERTICES:.0e} vertices; ask for "
            f"those from {smallest:.2g} on."
        )
    return _features(surface, finest, known_euler(report), max(finest / _CELLS_WITHIN, _smallest_cell(surface)))


def _smallest_cell(surface: TriangleSurface) -> float:
    """Of a grid with as many vertices as are allowed."""
    return float((np.ptp(surface.vertices, axis=0).prod() / _MOST_VERTICES) ** (1 / 3))


def _features(surface: TriangleSurface, finest: float, euler: int, cell: float | None = None) -> SolidFeatures:
    """On a grid of some cells, by default as many as are needed to find what is `finest` wide."""
    cell = finest / CELLS_PER_WIDTH if cell is None else cell
    found = tuple(one for one in solid_features(signed_distance(surface, cell)) if one.width >= finest)
    return SolidFeatures(found, finest, euler, _ERROR * cell)


def narrow_places(shape: Shape, below: float) -> tuple[NarrowPlace, ...]:
    """Where little more or less material would change the topology: thin walls and necks, narrow gaps and tunnels.

    The places are those of the surface that was found, whether or not it counts to the reported integer. Widths are
    those of `features`, and are measured likewise. Not differentiable.

    Args:
        below: largest width, in units of length.

    Returns:
        `NarrowPlace` records, narrowest first; those under a third of `below` may be missing.

    Raises:
        InputError: if no closed surface was found, or `below` is not positive or needs too fine a grid.
        MissingDependencyError: if cripser is not installed.

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import torus_mesh
        >>> for place in tk.from_mesh(torus_mesh(major=1.0, minor=0.6)).narrow_places(below=1.0):
        ...     print(place.kind, round(place.width, 1), place.change)  # a torus whose tunnel is filled is a ball
        narrow tunnel 0.8 2
    """
    surface = found_surface(shape)
    if surface is None or len(surface.faces) == 0:
        raise InputError(f"{shape.name} has no closed surface.")
    if shape.mesh is not None:  # others face outward
        surface = TriangleSurface(surface.vertices, mesh_topology(surface.vertices, surface.faces).faces)
    if not below > 0:
        raise InputError(f"below is {below!r}; a positive width in units of length was expected.")
    cell = max(below / _CELLS_BELOW, _smallest_cell(surface))
    if cell > below / CELLS_PER_WIDTH:
        raise InputError(
            f"{shape.name}: places narrower than {below:.4g} need a grid of more than {_MOST_VERTICES:.0e} vertices; "
            f"ask for those below {CELLS_PER_WIDTH * cell:.2g}."
        )
    return places_in(signed_distance(surface, cell), below)


def with_features(report: TopologyReport, shape: Shape, finest: float | None) -> TopologyReport:
    """The report with the widths of features; what cannot be measured is told by a sentence."""
    try:
        return replace(report, features=features(shape, finest))
    except TopokitError as error:
        return replace(report, reasons=(*report.reasons, f"Widths of features were not measured: {error}"))


def with_doubts(report: TopologyReport, shape: Shape) -> TopologyReport:
    """The report of a closed cloud with the places that are narrower than its resolution; others as they are.

    If they cannot be looked for, a sentence tells why.
    """
    if shape.counted is not None or not report.closed or report.resolution is None:
        return report
    below, euler = report.resolution, known_euler(report)
    try:
        return replace(report, doubts=shape._known.once("doubts", lambda: _doubts(shape, below, euler)))
    except TopokitError as error:
        note = f"Doubtful places were not looked for: {error}"
        return replace(report, reasons=(*report.reasons, note))


def _doubts(shape: Shape, below: float, euler: int) -> tuple[NarrowPlace, ...]:
    """Where the answer about a cloud may be wrong.

    These are its narrow places, each with the share of the votes that count as if it were otherwise: first those with
    most of them, of equals the narrowest. The places where samples are off the surface follow, unless noise does that.
    """
    places = narrow_places(shape, below)
    witness = shape._known.examination().witness
    if witness is None:
        return places
    counted = [value for vote in witness.votes for value in vote.eulers]
    voted = [replace(one, votes=share_of(euler + (one.change or 0), counted)) for one in places]
    voted.sort(key=lambda one: (-(one.votes or 0.0), one.width, one.place))
    if is_noisy(witness):
        return tuple(voted)
    missed = shape.samples.points[torch.from_numpy(witness.missed)].detach().cpu().double().numpy()
    return (*voted, *missed_places(missed, below / 2))
