"""Ways to look at a cloud: at all of its points, at samples where features are small, at averages, or as at a wire."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.cloud.axes import SurfaceAxes, surface_axes
from topokit.core.cloud.dense import MOST_POINTS, DenseCloud, averaged, dense_cloud, is_noisy
from topokit.core.cloud.downsampling import downsample
from topokit.core.cloud.findings import Preparation
from topokit.core.cloud.look import Cloud, Look
from topokit.core.cloud.look_at_all import look_at_all
from topokit.core.cloud.look_at_samples import look_at_samples
from topokit.core.cloud.solidity import fills_space
from topokit.core.cloud.wires import WireReading, looks_narrow, read_wire
from topokit.core.neighbors.kd_tree import nearest_in_tree
from topokit.core.progress import begin
from topokit.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_WIRE_SAMPLES = 10_000  # evenly spread points of a large cloud that is read as a wire


def look_at(cloud: Cloud) -> Look:
    """Look at a cloud in the way that its size, noise and shape ask for.

    Raises:
        InputError: if its points fill space, or all lie in a plane.
    """
    begin("neighborhoods")
    if len(cloud.points) <= MOST_POINTS:
        _refuse_space(cloud.points)
        return look_at_all(cloud, read_wire(cloud.points))
    surface = surface_axes(cloud.points)
    strand = _strand(cloud.points, surface.tree)
    if strand is not None:
        return _look_at_part(cloud, *strand, "wire")
    if not is_noisy(surface):
        return look_at_samples(_dense(cloud, surface), cloud)
    _refuse_space(cloud.points)
    kept, moved, is_thinned = averaged(cloud.points, surface.tree)
    strand = _strand(moved, cKDTree(moved))
    if strand is not None:
        part, moved, wire = strand
        return _look_at_part(cloud, kept[part], moved, wire, "averaged")
    return _look_at_part(cloud, kept, moved, None, "thinned" if is_thinned else "averaged")


def _strand(points: Floats, tree: cKDTree) -> tuple[Integers, Floats, WireReading] | None:
    """Evenly spread points of a cloud, their positions, and the reading of the cloud as a wire, if it is one."""
    if not looks_narrow(points, tree):
        return None
    kept, _ = downsample(points, _WIRE_SAMPLES, "even")
    wire = read_wire(points[kept])
    return None if wire is None else (kept, points[kept], wire)


def _refuse_space(points: Floats) -> None:
    if fills_space(points):
        raise InputError(
            f"the {len(points)} points fill space: neighborhoods of all sizes are as thick as they are wide, so they "
            "lie on no surface."
        )


def _look_at_part(
    cloud: Cloud, kept: Integers, moved: Floats, wire: WireReading | None, preparation: Preparation
) -> Look:
    """A look at some points, perhaps moved, as one at the cloud; every point has the normal of the nearest of them."""
    look = look_at_all(cloud.reduced(kept, moved), wire)
    nearest = nearest_in_tree(cKDTree(look.points), cloud.points, 1)
    return replace(look, kept=kept[look.kept], normals=look.normals[nearest], preparation=preparation)


def _dense(cloud: Cloud, surface: SurfaceAxes) -> DenseCloud:
    if cloud.areas is not None:
        surface = replace(surface, areas=cloud.areas)
    begin("signs")
    return dense_cloud(cloud.points, surface, cloud.normals)
