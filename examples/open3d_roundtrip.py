"""A torus as an open3d cloud, asked for its topology, and handed back with its Gaussian curvature as colours.

python examples/open3d_roundtrip.py [cloud.ply]
"""

from __future__ import annotations

import sys

import numpy as np
import open3d as o3d

import topokit as tk
from topokit.export.open3d import to_open3d
from topokit.testing import torus_samples


def main() -> None:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(torus_samples(10_000).points.numpy()))
    shape = tk.load(cloud)
    print(shape.report())

    coloured = to_open3d(shape.oriented())
    red, _, blue = np.asarray(coloured.colors).T
    print(
        f"  {len(coloured.points)} points: {(red > blue).mean():.0%} red (outer half), {(red < blue).mean():.0%} blue"
    )

    attributes = to_open3d(shape.oriented(), color_by="mean", tensor=True).point
    print(f"  as tensors: {', '.join(sorted(name for name, _ in attributes.items()))}")
    if len(sys.argv) > 1:
        o3d.io.write_point_cloud(sys.argv[1], coloured)
        print(f"  written to {sys.argv[1]}")


if __name__ == "__main__":
    main()
