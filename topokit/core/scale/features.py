"""Parts, tunnels and cavities of a solid with their widths, by persistent homology of its signed distance.

Let S(r) be the points whose signed distance is at most r: the solid S(0), shrunk for r < 0 and grown for r > 0. A class
of the homology of S that appears at S(−a) and disappears at S(b) is a feature: its thickness is 2a, the diameter of the
largest ball that moves along it inside the solid, and its opening is 2b, that of the largest ball that fits through it
outside. Shrinking by more than a or growing by more than b removes it, so its width is the smaller of the two. Signed
distances of two solids that differ by at most ε everywhere have the same features but for changes of ε in a and b: what
is wider than 2ε in one is in the other. That is the stability of persistence diagrams.

References:
    D. Cohen-Steiner, H. Edelsbrunner, J. Harer, "Stability of persistence diagrams", DCG 37, 2007,
    doi:10.1007/s00454-006-1276-5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats
from topokit.core.components import Corner, corner
from topokit.core.removal import Kind
from topokit.core.scale.pairs import persistent_pairs
from topokit.core.scale.signed_distance import SignedDistance
from topokit.errors import InputError

KINDS: tuple[Kind, ...] = ("part", "tunnel", "cavity")

CELLS_PER_WIDTH = 3
"""Cells of the grid across the narrowest feature that is surely found (benchmarks/planted_widths.py)."""

_WITHIN = 0.75  # cells around a vertex in which the place is looked for that is farthest from the surface
_STEPS = 4  # of the places in that ball, to each side


@dataclass(frozen=True)
class Feature:
    """A part, tunnel or cavity of a solid.

    Attributes:
        kind: "part" (a connected component), "tunnel" (one for each handle) or "cavity".
        width: thickness or opening, whichever is smaller.
        thickness: diameter of the largest ball that moves along it inside the solid: that in a part, in the thinnest
            place of a handle, in the thinnest place of the wall around a cavity.
        opening: diameter of the largest ball outside that fits: through the gap to another part (infinite for the
            thickest part), through the narrowest place of a tunnel, into a cavity.
        at_thickness: center of the first ball.
        at_opening: center of the second; that of the first where the opening is infinite.
    """

    kind: Kind
    width: float
    thickness: float
    opening: float
    at_thickness: Corner
    at_opening: Corner

    @property
    def place(self) -> Corner:
        """A place in the part, the tunnel or the cavity."""
        return self.at_thickness if self.kind == "part" else self.at_opening


class SolidCounts(NamedTuple):
    """How many parts, tunnels and cavities a solid has; the surface around it follows."""

    pieces: int
    tunnels: int
    cavities: int

    @property
    def euler(self) -> int:
        """Euler characteristic of the surface."""
        return 2 * (self.pieces - self.tunnels + self.cavities)

    @property
    def genus(self) -> int:
        """Handles of the surface, summed over components."""
        return self.tunnels

    @property
    def components(self) -> int:
        """Connected components of the surface."""
        return self.pieces + self.cavities


@dataclass(frozen=True, eq=False)
class SolidFeatures:
    """The features of a solid from some width on.

    Attributes:
        features: narrowest first.
        finest: width from which all are found, in units of length.
        counts: how many features of each kind there are of all widths, as reported.
        error: of widths, nearly always at most, in units of length.
    """

    features: tuple[Feature, ...]
    finest: float
    counts: SolidCounts
    error: float

    def above(self, width: float) -> SolidCounts:
        """How many features of each kind are at least so wide.

        Args:
            width: in units of length, at least `finest`.

        Raises:
            InputError: if narrower features were not looked for.
        """
        if not width >= self.finest:
            raise InputError(
                f"features were looked for from a width of {self.finest:.4g} on, so those above {width:.4g} are not "
                f"known: ask again for finer ones, shape.features(above={width:.4g})."
            )
        wide = [one.kind for one in self.features if one.width >= width]
        pieces, tunnels, cavities = map(wide.count, KINDS)
        return SolidCounts(pieces, tunnels, cavities)

    @property
    def narrower(self) -> SolidCounts:
        """How many features of each kind are narrower than `finest`; negative where the grid shows some more."""
        pieces, tunnels, cavities = (a - b for a, b in zip(self.counts, self.above(self.finest), strict=True))
        return SolidCounts(pieces, tunnels, cavities)

    def curve(self) -> tuple[tuple[float, int], ...]:
        """The Euler characteristic of the features from each width on: widths, ascending from `finest`, with χ."""
        starts = sorted({self.finest, *(math.nextafter(one.width, math.inf) for one in self.features[:-1])})
        return tuple((start, self.above(start).euler) for start in starts if math.isfinite(start))


def solid_features(distance: SignedDistance) -> tuple[Feature, ...]:
    """The features of a solid, narrowest first; those at least three cells wide are found.

    Args:
        distance: signed distance to its surface.

    Raises:
        MissingDependencyError: if cripser is not installed.
    """
    pairs = persistent_pairs(distance).chosen(lambda birth, death: (birth < 0) & (death > 0))
    inner, at_inner = largest_balls(distance, pairs.born)
    outer, at_outer = largest_balls(distance, pairs.dead)
    outer[np.isinf(pairs.death)] = math.inf
    found = [
        Feature(KINDS[dimension], 2 * float(min(a, b)), 2 * float(a), 2 * float(b), corner(p), corner(q))
        for dimension, a, b, p, q in zip(pairs.dimension.tolist(), inner, outer, at_inner, at_outer, strict=True)
    ]
    finest = CELLS_PER_WIDTH * distance.cell
    return tuple(sorted((one for one in found if one.width >= finest), key=lambda one: (one.width, one.place)))


def largest_balls(distance: SignedDistance, vertices: Floats) -> tuple[Floats, Floats]:
    """The largest distance to the surface (M,) near some vertices (M, 3) of the grid, and the places (M, 3)."""
    if len(vertices) == 0:
        return np.empty(0), np.empty((0, 3))
    axis = np.arange(-_STEPS, _STEPS + 1) / _STEPS * _WITHIN
    around = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    around = around[np.linalg.norm(around, axis=1) <= _WITHIN]
    places = distance.place(vertices[:, None] + around)
    found = cKDTree(distance.samples).query(places.reshape(-1, 3))[0].reshape(places.shape[:2])
    best = found.argmax(1)
    rows = np.arange(len(vertices))
    return found[rows, best], places[rows, best]
