"""Make examples/bracket.stl, the part in the README, and its picture with a loop at every hole (needs manifold3d).

python docs/pictures/make_bracket.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from manifold3d import Manifold, OpType

import topokit as tk

PART = Path(__file__).parents[2] / "examples" / "bracket.stl"
PICTURE = Path(__file__).with_name("bracket.webp")


def main() -> None:
    """Write the part, then its picture."""
    mesh = bracket().to_mesh()
    trimesh.Trimesh(np.asarray(mesh.vert_properties)[:, :3], mesh.tri_verts).export(PART)
    tk.load(PART).picture(480, eye=(0.7, 1.3, 1.1), locate=True).save(PICTURE, quality=80)
    print(f"{PART}: {tk.report(PART)}")


def bracket() -> Manifold:
    """An angle of 60 × 40 × 40 mm, 5 mm thick, with a rib, four screw holes and a slot."""
    base, wall = Manifold.cube((60, 40, 5)), Manifold.cube((60, 5, 40))
    rib = Manifold.hull_points([(x, y, z) for x in (28, 32) for y, z in ((4, 4), (34, 4), (4, 34))])
    screw = Manifold.cylinder(20, 3, 3, 48)
    holes = [screw.translate((x, y, -5)) for x in (12, 48) for y in (14, 30)]
    slot = Manifold.batch_hull([screw.translate((x, 0, -5)) for x in (24, 36)]).rotate((90, 0, 0)).translate((0, 5, 37))
    return base + wall + rib - Manifold.batch_boolean([*holes, slot.translate((0, 0, -1))], OpType.Add)


if __name__ == "__main__":
    main()
