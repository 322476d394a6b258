"""Clouds on which single settings act: wires, open surfaces, filled space, far clumps, double sheets, cut walls."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from topokit.testing import (
    AnalyticSamples,
    cylinder_samples,
    hemisphere_samples,
    plate_samples,
    sphere_samples,
    torus_samples,
)

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from tubes import cube_edges, linked_rings, torus_knot, tube

Floats = NDArray[np.float64]
KNOTS = ((2, 3), (2, 5), (3, 4), (3, 7))
CLUMP = 25  # points of a clump far away, fewer than bound a solid
WALL = 0.12  # of the hollow box that is cut through, in its lengths


@dataclass(frozen=True)
class Cloud:
    """Points (N, 3) of a surface of known Euler characteristic, None if they are of none; perhaps normals (N, 3)."""

    points: torch.Tensor
    normals: torch.Tensor | None
    truth: int | None


Makers = Iterator[tuple[str, Callable[[], Cloud]]]


def wires() -> Makers:
    """Tubes along the edges of a cube, knots and linked rings: thin, of few points, of many, and thick."""
    made = {
        "cube": (cube_edges(), 0.02, 3_000, -8),
        "rings": (linked_rings(), 0.02, 3_000, 0),
        **{f"knot {p} {q}": (torus_knot(p, q, 40 * p), 0.02, 3_000, 0) for p, q in KNOTS},
        "few": (torus_knot(2, 3), 0.02, 700, 0),
        "many": (cube_edges(), 0.02, 15_000, -8),
        "thick": (torus_knot(2, 3), 0.07, 3_000, 0),
    }
    for name, (segments, radius, count, truth) in made.items():

        def cloud(segments: Floats = segments, radius: float = radius, count: int = count, truth: int = truth) -> Cloud:
            return Cloud(torch.from_numpy(tube(segments, radius, count)[0]), None, truth)

        yield name, cloud


def sheets() -> Makers:
    """Open surfaces of 2 000 points."""
    for seed in range(4):

        def generator(seed: int = seed) -> torch.Generator:
            return torch.Generator().manual_seed(seed)

        yield f"cap {seed}", lambda g=generator: Cloud(hemisphere_samples(2_000, generator=g()).points, None, 1)
        yield f"tube {seed}", lambda g=generator: Cloud(cylinder_samples(2_000, generator=g()).points, None, 0)
        yield f"plate {seed}", lambda g=generator: Cloud(plate_samples(2_000, generator=g()).points, None, 1)

        def half_torus(g: Callable[[], torch.Generator] = generator) -> Cloud:
            points = torus_samples(4_000, generator=g()).points
            return Cloud(points[points[:, 2] > 0], None, 0)

        yield f"half torus {seed}", half_torus


def filled() -> Makers:
    """Boxes of points that lie on no surface, and a sphere and a torus so noisy that they nearly fill space."""
    for count in (7_000, 15_000):
        yield (
            f"box {count}",
            lambda n=count: Cloud(torch.from_numpy(np.random.default_rng(0).random((n, 3))), None, None),
        )
    for name, make, truth in (("sphere", sphere_samples, 2), ("torus", torus_samples, 0)):

        def noisy(make: Callable[[int], AnalyticSamples] = make, truth: int = truth) -> Cloud:
            noise = torch.from_numpy(np.random.default_rng(0).normal(size=(12_000, 3)))
            return Cloud(make(12_000).points + 0.06 * noise, None, truth)

        yield f"noisy {name}", noisy


def clumps() -> Makers:
    """A torus, and a clump of points at 20 to 50 times its radius, which is no part of the scene."""
    for distance in (20.0, 40.0, 50.0):

        def cloud(distance: float = distance) -> Cloud:
            clump = 0.1 * sphere_samples(CLUMP).points + torch.tensor([distance, 0, 0])
            return Cloud(torch.cat((torus_samples(3_000).points, clump)), None, 0)

        yield f"at {distance:g}", cloud


def shells() -> Makers:
    """Spheres of 5 000 points within spheres of as many, with noise, and one whose points are noisy alone."""
    spacing = (4 * np.pi / 5_000) ** 0.5
    for apart, noise in ((0.4, 0.0), (0.8, 0.1), (1.5, 0.3), (0.0, 0.6)):

        def cloud(apart: float = apart, noise: float = noise) -> Cloud:
            random = np.random.default_rng(0)
            outer, inner = (sphere_samples(5_000, generator=torch.Generator().manual_seed(k)).points for k in (0, 1))
            points = torch.cat((outer, (1 - apart * spacing) * inner))
            moved = points + noise * spacing * torch.from_numpy(random.normal(size=points.shape))
            return Cloud(moved, None, 4 if apart else 2)

        yield f"{apart:g} apart, noise {noise:g}", cloud


def nested() -> Makers:
    """A hollow ball whose inner normals point out of the cavity, small or large."""
    for radius in (0.15, 0.3, 0.6):

        def cloud(radius: float = radius) -> Cloud:
            outer, inner = sphere_samples(4_000).points, sphere_samples(int(4_000 * radius)).points
            return Cloud(torch.cat((outer, radius * inner)), torch.cat((outer, inner)), 4)

        yield f"cavity {radius:g}", cloud


def cut_walls() -> Makers:
    """Hollow boxes that a plane cut through: a wide hole, and a narrow one whose rim shows the wall."""
    for height in (0.3, 0.9):

        def cloud(height: float = height) -> Cloud:
            random = np.random.default_rng(0)
            outer, inner = (_box(random, 8_000, side) for side in (1.0, 1 - 2 * WALL))
            points = np.concatenate((outer, inner))
            return Cloud(torch.from_numpy(points[points[:, 2] < height - 0.5]), None, None)

        yield f"cut at {height:g}", cloud


def _box(random: np.random.Generator, count: int, side: float) -> Floats:
    """Points (count · side², 3) of the surface of a cube around the origin."""
    n_points = int(count * side**2)
    points = random.uniform(-0.5, 0.5, (n_points, 3))
    points[np.arange(n_points), random.integers(0, 3, n_points)] = random.choice([-0.5, 0.5], n_points)
    return side * points
