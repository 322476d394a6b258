"""Random solids of counted topology, made here, as closed triangle meshes: material for calibration.

Each solid is the level set of a few random primitives (balls, boxes, plates, rods, rings, shells, lattices, smoothed
noise), joined and subtracted at random. Its truth is the count of its own mesh. Primitives that nearly touch make necks
and tunnels smaller than the cells of the grid, whose number is an accident of the grid. Solids that have such are made
again: half a cell inward and outward, and under both connectivities, the topology must be that of the mesh.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from skimage.measure import euler_number, marching_cubes

Floats = NDArray[np.float64]
Primitive = Callable[[Floats, np.random.Generator], Floats]

RESOLUTION = 112  # grid cells along one side of the cube in which a solid is made
CELL = 2.4 / (RESOLUTION - 1)
LARGEST_EULER = 120  # solids of larger |χ| are made again
MOST_SURFACES = 6  # solids with more surfaces are made again
SMALLEST_PART = 0.005  # share of the area below which a component is dust, which no sampling can be blamed for missing


def random_solid(seed: int) -> trimesh.Trimesh:
    """A closed manifold mesh, oriented outward; the same for the same seed."""
    rng = np.random.default_rng(seed)
    while True:
        mesh = _mesh(_field(rng))
        if mesh is not None:
            return mesh


def _field(rng: np.random.Generator) -> Floats:
    axis = np.linspace(-1.2, 1.2, RESOLUTION)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    field = np.full(grid.shape[:3], np.inf)
    for _ in range(rng.integers(1, 6)):
        field = np.minimum(field, _primitive(grid, rng, SOLIDS))
    for _ in range(rng.integers(0, 6)):
        field = np.maximum(field, -_primitive(grid, rng, TOOLS))
    if rng.random() < 0.15:
        field = np.abs(field) - rng.uniform(0.02, 0.06)  # a shell of it
    return field


def _mesh(field: Floats) -> trimesh.Trimesh | None:
    closed = np.pad(field, 1, constant_values=1.0)
    if not (closed < 0).any():
        return None
    vertices, faces, _, _ = marching_cubes(closed, 0.0, spacing=(CELL,) * 3, gradient_direction="ascent")
    mesh = trimesh.Trimesh(vertices, faces, process=True)
    if mesh.volume < 0:
        mesh.invert()
    parts = mesh.split(only_watertight=False)
    usable = mesh.is_watertight and abs(mesh.euler_number) <= LARGEST_EULER and len(parts) <= MOST_SURFACES
    usable = usable and min(part.area for part in parts) >= SMALLEST_PART * mesh.area
    return mesh if usable and _is_settled(closed, mesh.euler_number) else None


def _is_settled(field: Floats, euler: int) -> bool:
    """Whether a surface of this Euler characteristic bounds the solid at all levels within half a cell."""
    levels = (-CELL / 2, 0.0, CELL / 2)
    return all(2 * euler_number(field < level, connectivity=k) == euler for level in levels for k in (1, 3))


def _primitive(grid: Floats, rng: np.random.Generator, kinds: tuple[Primitive, ...]) -> Floats:
    turn = Rotation.random(rng=rng).as_matrix() if rng.random() < 0.6 else np.eye(3)
    local = (grid - rng.uniform(-0.5, 0.5, 3)) @ turn
    return kinds[rng.integers(len(kinds))](local, rng)


def _ball(x: Floats, rng: np.random.Generator) -> Floats:
    return np.linalg.norm(x * rng.uniform(0.7, 1.4, 3), axis=-1) - rng.uniform(0.25, 0.55)


def _box(x: Floats, rng: np.random.Generator) -> Floats:
    return _box_distance(x, rng.uniform(0.15, 0.55, 3))


def _plate(x: Floats, rng: np.random.Generator) -> Floats:
    return _box_distance(x, np.array([*rng.uniform(0.3, 0.7, 2), rng.uniform(0.02, 0.06)]))


def _rod(x: Floats, rng: np.random.Generator) -> Floats:
    radius = rng.uniform(0.04, 0.2)
    return np.maximum(np.linalg.norm(x[..., :2], axis=-1) - radius, np.abs(x[..., 2]) - rng.uniform(0.3, 0.9))


def _ring(x: Floats, rng: np.random.Generator) -> Floats:
    around = np.linalg.norm(x[..., :2], axis=-1) - rng.uniform(0.3, 0.55)
    return np.hypot(around, x[..., 2]) - rng.uniform(0.04, 0.16)


def _hollow(x: Floats, rng: np.random.Generator) -> Floats:
    return np.abs(_ball(x, rng)) - rng.uniform(0.02, 0.06)


def _lattice(x: Floats, rng: np.random.Generator) -> Floats:
    waves = x * rng.uniform(6, 11)
    gyroid = (np.sin(waves) * np.cos(np.roll(waves, 1, axis=-1))).sum(-1)
    return np.maximum(gyroid / 8 + rng.uniform(-0.04, 0.04), _box_distance(x, rng.uniform(0.3, 0.5, 3)))


def _noise(x: Floats, rng: np.random.Generator) -> Floats:
    smooth = gaussian_filter(rng.normal(size=x.shape[:3]), rng.uniform(7, 12))
    return np.maximum(0.15 * smooth / smooth.std() + 0.02, np.linalg.norm(x, axis=-1) - 0.7)


def _perforation(x: Floats, rng: np.random.Generator) -> Floats:
    pitch = rng.uniform(0.2, 0.4)
    nearest = (x[..., :2] + pitch / 2) % pitch - pitch / 2
    return np.linalg.norm(nearest, axis=-1) - pitch * rng.uniform(0.15, 0.35)


def _box_distance(x: Floats, half: Floats) -> Floats:
    return (np.abs(x) - half).max(-1)


SOLIDS: tuple[Primitive, ...] = (_ball, _box, _plate, _rod, _ring, _hollow, _lattice, _noise)
TOOLS: tuple[Primitive, ...] = (_ball, _box, _rod, _rod, _ring, _perforation)
