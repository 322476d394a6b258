"""Is an Euler characteristic that of a mesh's solid without the features narrower than a width?

    python benchmarks/scale_truth.py judge MESH EULER WIDTH
    python benchmarks/scale_truth.py table MESH [MESH ...] [--shares 0.02 0.04 0.08]

The closing of a solid with a ball fills the tunnels, gaps and cavities into which the ball does not fit; the opening
removes the walls, rods and parts that do not hold it. An integer is right at a width w if it is that of the solid, of
its closing, of its opening, or of one after the other, for some ball of a diameter up to w. The solid is filled on a
grid with ten cells per width. The table has the integers of the closing and of the opening of each mesh, for widths in
shares of its longest side.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import open3d
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from skimage.measure import euler_number

import topokit as tk

Booleans = NDArray[np.bool_]

MOST_CELLS = 420  # along the longest side
TABLE_CELLS = 150  # the same for the table
SHARES = (0.25, 0.5, 0.75, 1.0)  # of the width that are tried as diameters
OFFSETS = (1e-3, 1.7e-3, 2.3e-3)  # of the grid, in cells: rays along symmetry planes of a part graze its edges


def mesh_of(path: Path) -> trimesh.Trimesh:
    """The mesh of a file as topokit reads it, with its vertices merged."""
    mesh = tk.from_mesh(path).mesh
    assert mesh is not None
    return trimesh.Trimesh(*(part.numpy() for part in mesh), process=False)


def right_at_scale(mesh: trimesh.Trimesh, euler: int, width: float) -> bool:
    """Whether an integer is right at a width, in the mesh's units.

    Args:
        mesh: closed, oriented.
        euler: Euler characteristic of a surface.
        width: of the widest features that may be missing.
    """
    if euler == mesh.euler_number:
        return True
    cell = max(width / 10, float(np.ptp(mesh.vertices, axis=0).max()) / MOST_CELLS)
    solid = filled(mesh, cell, width + 3 * cell)
    radii = [share * width / 2 / cell for share in SHARES]
    return any(euler in eulers_without(solid, radius) for radius in radii if radius >= 0.9)


def raycaster(mesh: trimesh.Trimesh) -> open3d.t.geometry.RaycastingScene:
    """What answers questions about rays, distances and the inside of a mesh."""
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    return scene


def filled(mesh: trimesh.Trimesh, cell: float, margin: float) -> Booleans:
    """The cells of a grid whose centers are inside a mesh."""
    scene = raycaster(mesh)
    low = mesh.vertices.min(0) - margin
    counts = np.ceil((np.ptp(mesh.vertices, axis=0) + 2 * margin) / cell).astype(int)
    x, y, z = (low[i] + cell * (np.arange(counts[i]) + 0.5 + OFFSETS[i]) for i in range(3))
    layers = []
    for height in x:  # one layer at a time in memory
        centers = np.stack(np.meshgrid([height], y, z, indexing="ij"), axis=-1).astype(np.float32)
        layers.append(scene.compute_occupancy(centers, nsamples=3).numpy()[0] > 0)
    return np.stack(layers)


def eulers_without(solid: Booleans, radius: float) -> set[int]:
    """Euler characteristics of a solid's closing, opening and both, with a ball of a radius in cells."""
    first_closed, first_opened = closing(solid, radius), opening(solid, radius)
    found = (first_closed, first_opened, opening(first_closed, radius), closing(first_opened, radius))
    return {2 * int(euler_number(one, connectivity=k)) for one in found for k in (1, 3)}


def closing(solid: Booleans, radius: float) -> Booleans:
    """A solid grown by a radius in cells and shrunk again."""
    return _shrunk(_grown(solid, radius), radius)


def opening(solid: Booleans, radius: float) -> Booleans:
    """A solid shrunk by a radius in cells and grown again."""
    return _grown(_shrunk(solid, radius), radius)


def _grown(solid: Booleans, radius: float) -> Booleans:
    return np.asarray(distance_transform_edt(~solid) <= radius) if solid.any() else solid


def _shrunk(solid: Booleans, radius: float) -> Booleans:
    return np.asarray(distance_transform_edt(solid) > radius)


def eulers_at(mesh: trimesh.Trimesh, width: float) -> tuple[int, int]:
    """Euler characteristic of the surface of a solid whose tunnels, gaps and cavities up to a width are filled, and of
    one whose walls, rods and parts up to it are removed; voxels are connected over faces, edges and corners.

    Args:
        mesh: closed, oriented.
        width: in the mesh's units.
    """
    cell = max(width / 10, float(np.ptp(mesh.vertices, axis=0).max()) / TABLE_CELLS)
    solid, radius = filled(mesh, cell, width + 3 * cell), width / 2 / cell
    closed, opened = (euler_number(one, connectivity=3) for one in (closing(solid, radius), opening(solid, radius)))
    return 2 * int(closed), 2 * int(opened)


def print_table(paths: Sequence[Path], shares: Sequence[float]) -> None:
    """A row for each mesh: its integer, then those without what is narrower than each share of its longest side."""
    print(f"| mesh | χ | {' | '.join(f'{share:.0%} filled | {share:.0%} removed' for share in shares)} |")
    print("|---" * (2 + 2 * len(shares)) + "|")
    for path in paths:
        mesh = mesh_of(path)
        length = float(np.ptp(mesh.vertices, axis=0).max())
        known = [str(euler) for share in shares for euler in eulers_at(mesh, share * length)]
        print(f"| {path.stem} | {mesh.euler_number} | {' | '.join(known)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    judge = commands.add_parser("judge")
    judge.add_argument("mesh", type=Path)
    judge.add_argument("euler", type=int)
    judge.add_argument("width", type=float)
    judge.set_defaults(
        run=lambda it: print("right" if right_at_scale(mesh_of(it.mesh), it.euler, it.width) else "wrong")
    )
    table = commands.add_parser("table")
    table.add_argument("meshes", type=Path, nargs="+")
    table.add_argument("--shares", type=float, nargs="+", default=(0.02, 0.04, 0.08))
    table.set_defaults(run=lambda it: print_table(it.meshes, it.shares))
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
