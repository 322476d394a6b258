"""Narrow places: where little more or less material would change the topology of a solid.

The topology of S(r), the points of signed distance at most r, changes where a class of its homology appears or
disappears. Changes at small r > 0 are gaps, tunnels and cavities that are nearly closed; those at small r < 0 are walls
and necks that are nearly gone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats
from topokit.core.components import Corner, corner
from topokit.core.labels import connected_labels
from topokit.core.scale.features import CELLS_PER_WIDTH, largest_balls
from topokit.core.scale.pairs import persistent_pairs
from topokit.core.scale.signed_distance import MOST_VERTICES, SignedDistance, signed_distance, smallest_cell
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError

NarrowKind = Literal[
    "thin part",
    "thin handle",
    "thin wall",
    "thin neck",
    "thin membrane",
    "narrow gap",
    "narrow tunnel",
    "narrow mouth",
    "small cavity",
    "missed samples",
]

_LEAVING: tuple[NarrowKind, ...] = ("thin part", "thin handle", "thin wall")  # a feature that shrinking removes
_PARTING: tuple[NarrowKind, ...] = ("thin neck", "thin membrane", "thin wall")  # one that shrinking adds
_CLOSING: tuple[NarrowKind, ...] = ("narrow gap", "narrow tunnel", "small cavity")  # one that growing removes
_JOINING: tuple[NarrowKind, ...] = ("narrow gap", "narrow gap", "narrow mouth")  # one that growing adds

_CELLS_BELOW = 6  # across the largest width of narrow places
_FEWEST_MISSED = 3  # samples off the surface: by chance they are alone
_SHORTEST = 1.5  # cells of r over which a class must last: shorter ones are those of the grid


@dataclass(frozen=True)
class NarrowPlace:
    """A place where little more or less material would change the topology.

    Attributes:
        kind: "thin part", "thin handle" or "thin wall" (around a cavity): would be gone; "thin neck" or "thin
            membrane": would part, and so add a part or a tunnel; "narrow gap" (between parts, or one that closes to a
            handle), "narrow tunnel", "narrow mouth" (of what becomes a cavity) or "small cavity": would close. "missed
            samples" of a cloud lie off its surface, where a tunnel may be filled or a sheet left out.
        width: diameter of the largest ball that fits there; of samples the longest side of their box.
        place: its center.
        change: of the Euler characteristic of the surface, if it were gone, parted or closed; None of samples.
        votes: share of the votes on a cloud that count the Euler characteristic with this change; None without votes.
    """

    kind: NarrowKind
    width: float
    place: Corner
    change: int | None
    votes: float | None = None


def surface_places(
    surface: TriangleSurface, below: float, most_vertices: int = MOST_VERTICES
) -> tuple[NarrowPlace, ...]:
    """The narrow places of the solid inside a surface, narrowest first.

    Args:
        surface: closed triangles, counterclockwise seen from outside the solid.
        below: largest width, in units of length.
        most_vertices: of the grid, on which there are six cells across that width, or three if six take too many.

    Raises:
        InputError: if `below` is not positive or needs too fine a grid, or the surface is not closed.
        MissingDependencyError: if cripser is not installed.
    """
    if not below > 0:
        raise InputError(f"below is {below!r}; a positive width in units of length was expected.")
    finest = smallest_cell(surface, most_vertices)
    cell = max(below / _CELLS_BELOW, finest)
    if cell > below / CELLS_PER_WIDTH:
        raise InputError(
            f"places narrower than {below:.4g} need a grid of more than {most_vertices:.0e} vertices; ask for those "
            f"below {CELLS_PER_WIDTH * finest:.2g}."
        )
    return narrow_places(signed_distance(surface, cell), below)


def narrow_places(distance: SignedDistance, below: float) -> tuple[NarrowPlace, ...]:
    """The narrow places of a solid, narrowest first; a feature that could go in two ways is two of them.

    Args:
        distance: signed distance to its surface, with several cells across `below`.
        below: largest width, in units of length.

    Raises:
        MissingDependencyError: if cripser is not installed.
    """
    least = _SHORTEST * distance.cell
    pairs = persistent_pairs(distance).chosen(lambda birth, death: death - birth > least)
    is_there = (pairs.birth < 0) & (pairs.death > 0)
    is_born_near, is_dead_near = (np.abs(radius) <= below / 2 for radius in (pairs.birth, pairs.death))
    groups = (
        (_LEAVING, -1, pairs.born, is_there & is_born_near),
        (_CLOSING, -1, pairs.dead, is_there & is_dead_near),
        (_JOINING, 1, pairs.born, (pairs.birth >= 0) & is_born_near),
        (_PARTING, 1, pairs.dead, (pairs.death <= 0) & is_dead_near),
    )
    found = []
    for kinds, sign, vertices, chosen in groups:
        radii, places = largest_balls(distance, vertices[chosen])
        found += [
            NarrowPlace(kinds[dimension], 2 * float(radius), corner(place), sign * (-2 if dimension == 1 else 2))
            for dimension, radius, place in zip(pairs.dimension[chosen].tolist(), radii, places, strict=True)
            if 2 * radius <= below
        ]
    return tuple(sorted(found, key=lambda one: (one.width, one.place)))


def missed_places(samples: Floats, apart: float) -> tuple[NarrowPlace, ...]:
    """Where several samples lie off the surface that was found.

    Args:
        samples: (M, 3), those off the surface.
        apart: distance of neighbors in one place.
    """
    pairs = cKDTree(samples).query_pairs(apart, output_type="ndarray")
    place = connected_labels(len(samples), *pairs.T)
    groups = (samples[place == number] for number in np.flatnonzero(np.bincount(place) >= _FEWEST_MISSED))
    boxes = ((group.min(0), group.max(0)) for group in groups)
    return tuple(
        NarrowPlace("missed samples", float((high - low).max()), corner((low + high) / 2), None) for low, high in boxes
    )
