"""Solids with planted features of known widths, as closed triangle meshes: material for calibration by scale.

Each family plants features of one kind (holes, rungs, gaps, parts, cavities, loops, walls) whose widths are spread
log-uniformly around the sample spacing. The width of a feature is the diameter of the largest ball that fits at its
narrowest place. Filling or removing it changes the Euler characteristic of the surface by a known integer, so the truth
is known at every width.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from trimesh.creation import annulus, box, cylinder, icosphere, torus

Floats = NDArray[np.float64]

NARROWEST, WIDEST = 0.2, 20.0  # widths of planted features, in sample spacings
_SIDES = 32  # of a round hole or rod


@dataclass(frozen=True, eq=False)
class Planted:
    """A solid and what is known about it.

    Attributes:
        mesh: closed, oriented outward.
        euler: Euler characteristic of its surface.
        features: width of each planted feature, and the change of the Euler characteristic when all that are no wider
            are filled or removed, narrowest first.
    """

    mesh: trimesh.Trimesh
    euler: int
    features: tuple[tuple[float, int], ...]

    def right_at(self, euler: int, width: float) -> bool:
        """Whether an integer is that of the solid without features narrower than some width up to this one."""
        truths = {self.euler} | {self.euler + change for own, change in self.features if own <= width}
        return euler in truths


def _planted(
    mesh: trimesh.Trimesh, widths: Sequence[float], each: int, limits: Sequence[tuple[float, int]] = ()
) -> Planted:
    """A solid whose features each change the Euler characteristic by the same integer."""
    features = [(width, each * (k + 1)) for k, width in enumerate(sorted(widths))]
    return Planted(mesh, int(mesh.euler_number), (*features, *limits))


def _widths(rng: np.random.Generator, spacing: float, count: int, most: float) -> Floats:
    low, high = NARROWEST * spacing, min(WIDEST * spacing, most)
    return np.asarray(np.exp(rng.uniform(np.log(min(low, high / 2)), np.log(high), count)))


def _grid_places(rng: np.random.Generator, count: int) -> tuple[Floats, float]:
    """Places (count, 2) in the unit square about 0, and the distance between them."""
    side = int(np.ceil(np.sqrt(count)))
    cells = rng.permutation(side * side)[:count]
    return (np.stack([cells // side, cells % side], 1) + 0.5) / side - 0.5, 1 / side


def perforated(rng: np.random.Generator, spacing: float) -> Planted:
    """A plate or block with round holes."""
    places, pitch = _grid_places(rng, int(rng.integers(1, 10)))
    widths = _widths(rng, spacing, len(places), 0.7 * pitch)
    thick = float(np.exp(rng.uniform(np.log(2 * spacing), np.log(0.5)))) if 2 * spacing < 0.5 else 0.5
    holes = [
        cylinder(width / 2, 2 * thick, sections=_SIDES, transform=at(*place, 0))
        for width, place in zip(widths, places, strict=True)
    ]
    return _planted(_cut(box((1.0, 1.0, thick)), holes), widths, 2)


def ladder(rng: np.random.Generator, spacing: float) -> Planted:
    """Two blocks joined by rods; a thin rod may seem to be missing."""
    places, pitch = _grid_places(rng, int(rng.integers(2, 8)))
    widths = _widths(rng, spacing, len(places), 0.6 * pitch)
    widths[0] = min(WIDEST * spacing, 0.6 * pitch)
    rods = [
        cylinder(width / 2, 0.5, sections=_SIDES, transform=at(*(0.9 * place), 0))
        for width, place in zip(widths, places, strict=True)
    ]
    blocks = [box((1.0, 1.0, 0.3), transform=at(0, 0, z)) for z in (-0.35, 0.35)]
    return _planted(_joined([*blocks, *rods]), widths, 2)


def gaps(rng: np.random.Generator, spacing: float) -> Planted:
    """A block with round bars across slots that end in a gap before the far wall: a filled gap makes a handle."""
    count = int(rng.integers(1, 5))
    widths = _widths(rng, spacing, count, 0.3)
    frame = _cut(box((1.0, 1.0, 0.2)), [box((0.8, 0.8, 0.4))])
    bars = [
        box((0.85 - width, 0.06, 0.1), transform=at(-0.45 + (0.85 - width) / 2, y, 0))
        for width, y in zip(widths, np.linspace(-0.3, 0.3, count), strict=True)
    ]
    return _planted(_joined([frame, *bars]), widths, -2)


def parts(rng: np.random.Generator, spacing: float) -> Planted:
    """A ring and small balls around it."""
    count = int(rng.integers(1, 6))
    widths = _widths(rng, spacing, count, 0.2)
    angles = np.arange(count) * 2 * np.pi / count
    balls = [
        icosphere(3, width / 2).apply_translation((0.6 * np.cos(t), 0.6 * np.sin(t), 0.0))
        for width, t in zip(widths, angles, strict=True)
    ]
    return _planted(trimesh.util.concatenate([torus(0.3, 0.12, 48, 24), *balls]), widths, -2)


def cavities(rng: np.random.Generator, spacing: float) -> Planted:
    """A block with round cavities."""
    places, pitch = _grid_places(rng, int(rng.integers(1, 6)))
    widths = _widths(rng, spacing, len(places), 0.6 * pitch)
    thick = float(max(widths.max() * 1.5, rng.uniform(0.3, 1.0)))
    balls = []
    for width, place in zip(widths, places, strict=True):
        ball = icosphere(3, width / 2).apply_translation((*place, 0.0))
        ball.invert()
        balls.append(ball)
    return _planted(trimesh.util.concatenate([box((1.0, 1.0, thick)), *balls]), widths, -2)


def loops(rng: np.random.Generator, spacing: float) -> Planted:
    """A body with thin rings through its skin: each is a handle."""
    count = int(rng.integers(1, 7))
    widths = _widths(rng, spacing, count, 0.12)
    places = (np.arange(count) + 0.5) / count - 0.5
    rings = []
    for width, x in zip(widths, places, strict=True):
        ring = torus(0.15, width / 2, 48, 16)
        ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
        rings.append(ring.apply_translation((x, 0.0, 0.25)))
    return _planted(_joined([box((1.2, 0.6, 0.5)), *rings]), widths, 2)


def pipe(rng: np.random.Generator, spacing: float) -> Planted:
    """A tube with a thin wall: removed whole where the wall is thin, never filled."""
    wall, radius = float(_widths(rng, spacing, 1, 0.2)[0]), float(rng.uniform(0.25, 0.5))
    mesh = annulus(radius - wall, radius, float(rng.uniform(0.2, 1.5)), sections=64)
    return _planted(mesh, (wall,), 0)


def shell(rng: np.random.Generator, spacing: float) -> Planted:
    """A hollow ball or box with a thin wall: removed whole where the wall is thin."""
    wall = float(_widths(rng, spacing, 1, 0.2)[0])
    outer, inner = (
        (icosphere(4, 0.5), icosphere(4, 0.5 - wall))
        if rng.random() < 0.5
        else (box((1.0, 0.8, 0.6)), box((1.0 - 2 * wall, 0.8 - 2 * wall, 0.6 - 2 * wall)))
    )
    inner.invert()
    return _planted(trimesh.util.concatenate([outer, inner]), (wall,), -4)


def slotted(rng: np.random.Generator, spacing: float) -> Planted:
    """A box without a lid, with thin walls and a hole in each of some walls."""
    wall = float(_widths(rng, spacing, 1, 0.2)[0])
    cup = _cut(box((1.0, 1.0, 0.8)), [box((1 - 2 * wall, 1 - 2 * wall, 0.8), transform=at(0, 0, wall))])
    count = int(rng.integers(0, 3))
    widths = _widths(rng, spacing, count, 0.4)
    holes = [
        cylinder(width / 2, 0.6, sections=_SIDES, transform=at(x, 0, -0.4))
        for width, x in zip(widths, (-0.25, 0.25), strict=False)
    ]
    mesh = _cut(cup, holes)
    return _planted(mesh, widths, 2, ((wall, -int(mesh.euler_number)),))


FAMILIES: dict[str, Callable[[np.random.Generator, float], Planted]] = {
    kind.__name__: kind for kind in (perforated, ladder, gaps, parts, cavities, loops, pipe, shell, slotted)
}
"""Each makes a solid about one unit long, for samples at a given spacing."""


def planted(family: str, seed: int, n_points: int) -> Planted:
    """A solid of a family, turned at random, with features around the spacing of `n_points` samples.

    The spacing is that of a first solid of the same draw; features change its area little.
    """
    spacing = np.sqrt(4.0 / n_points)
    for _ in range(2):
        found = FAMILIES[family](np.random.default_rng(seed), spacing)
        spacing = np.sqrt(found.mesh.area / n_points)
    turn = np.eye(4)
    turn[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    found.mesh.apply_transform(turn)
    return found


def at(x: float, y: float, z: float) -> Floats:
    """The matrix (4, 4) of a shift."""
    return np.asarray(trimesh.transformations.translation_matrix((x, y, z)))


def _cut(mesh: trimesh.Trimesh, tools: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    return trimesh.boolean.difference([mesh, *tools], engine="manifold") if tools else mesh


def _joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    return trimesh.boolean.union(list(meshes), engine="manifold")
