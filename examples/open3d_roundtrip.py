"""An open3d cloud of a torus: its topology, and the same cloud with its Gaussian curvature as colors.

python examples/open3d_roundtrip.py [cloud.ply]
"""

from __future__ import annotations

import sys

import numpy as np
import open3d as o3d

import topokit as tk
from topokit.export import to_open3d
from topokit.testing import torus_samples


def main() -> None:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(torus_samples(10_000).points.numpy()))
    shape = tk.load(cloud)
    print(shape.report())

    colored = to_open3d(shape.oriented())
    red, _, blue = np.asarray(colored.colors).T
    print(f"  {len(colored.points)} points: {(red > blue).mean():.0%} red (outer half), {(red < blue).mean():.0%} blue")

    attributes = to_open3d(shape.oriented(), color_by="mean", tensor=True).point
    print(f"  as tensors: {', '.join(sorted(name for name, _ in attributes.items()))}")
    if len(sys.argv) > 1:
        o3d.io.write_point_cloud(sys.argv[1], colored)
        print(f"  written to {sys.argv[1]}")


if __name__ == "__main__":
    main()
