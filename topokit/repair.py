"""Repair that is counted before it is returned: of small handles, boundary loops, and the Betti numbers of volumes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from topokit.adapters.mesh.adapter import from_mesh
from topokit.adapters.voxels.adapter import from_voxels
from topokit.adapters.voxels.field import VoxelField
from topokit.core.homotopy.enforced import enforced
from topokit.core.homotopy.nearest_solid import Change
from topokit.errors import InputError
from topokit.report.wording import plural
from topokit.shape import Shape

if TYPE_CHECKING:
    import trimesh


def simplify_topology(mesh: Any, *, below: float) -> trimesh.Trimesh:
    """A closed mesh without its small handles and tunnels, which in scans and generated meshes are mostly noise.

    The shorter of the two loops of a handle is its size and decides how it is removed: a handle loop is cut through, a
    tunnel loop is closed by a wall. Vertices away from these loops keep their places and their order. χ rises by two
    for each, which is counted before the mesh is returned.

    Args:
        mesh: whatever `from_mesh` takes as its first argument, or a `Shape` with a closed surface.
        below: length of the shorter loop, in units of the vertices; what is as long or longer stays.

    Raises:
        InputError: if the mesh is open or not a manifold (`fill_boundaries` closes holes), intersects itself, or is too
            coarse to be cut along a loop; or if `below` is not a positive number.

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import torus_mesh
        >>> tk.simplify_topology(torus_mesh(major=1, minor=0.1), below=1).euler_number
        2
    """
    return (mesh if isinstance(mesh, Shape) else from_mesh(mesh)).simplify_topology(below=below)


def fill_boundaries(mesh: Any) -> trimesh.Trimesh:
    """A mesh with every boundary loop closed by a fan of triangles.

    Vertices keep their places and their order; a vertex at which two boundary loops touch is doubled. What is filled is
    a closed manifold, which is counted before it is returned. Fans suit small holes: over a large and bent boundary
    they can pass through the surface.

    Args:
        mesh: whatever `from_mesh` takes as its first argument, or a `Shape` that was made from a mesh.

    Raises:
        InputError: if the mesh has edges with three faces or more or cannot be oriented, or the shape has no mesh.
    """
    return (mesh if isinstance(mesh, Shape) else from_mesh(mesh)).fill_boundaries()


def enforce(
    volume: Any, *, pieces: int = 1, tunnels: int = 0, cavities: int = 0, change: Change = "any", **options: Any
) -> Any:
    """A volume whose solid has given numbers of pieces, tunnels and cavities, with as few voxels changed as were found.

    Surplus pieces are dropped or joined, tunnels cut or filled, cavities filled or opened, whichever changes least: the
    fewest voxels near the surface of a binary volume or of a label, and the smallest values of a gray volume. A voxel
    that is changed takes the value of the nearest one on the other side. The search is a heuristic: there may be a
    volume that is nearer, and a feature of which the volume has no trace is not invented. What is found has exactly
    these numbers. Not differentiable; `TopologyLoss` is.

    Args:
        volume: (X, Y, Z) NumPy array or tensor, or whatever else `from_voxels` takes, or a `Shape` that it made.
        pieces: connected components of the solid.
        tunnels: of the solid; see `report().tunnels`.
        cavities: of the solid.
        change: whether voxels may only be added to the solid ("add"), only removed from it ("remove"), or both ("any").
        options: as for `from_voxels`: `level`, `label`, `connectivity`, `spacing`; not with a `Shape`.

    Returns:
        An array or tensor of the same type, if that was given, else a `Shape`.

    Raises:
        InputError: if no solid with these numbers was found, one of them is negative, the shape was not made from a
            volume in memory, or as for `from_voxels`.

    Example:
        >>> import numpy as np, topokit as tk
        >>> ring = np.ones((7, 7, 3), dtype=bool)
        >>> ring[3, 3] = False
        >>> int((tk.enforce(ring) != ring).sum())  # one voxel closes the tunnel
        1
    """
    wanted = (pieces, tunnels, cavities)
    if min(wanted) < 0:
        raise InputError(f"pieces, tunnels and cavities are {wanted}; numbers of at least 0 were expected.")
    shape = volume if isinstance(volume, Shape) else from_voxels(volume, **options)
    field = shape.field
    if not isinstance(field, VoxelField):
        raise InputError(f"{shape.name} was not made from a volume in memory: only the voxels of one can be changed.")
    before = field.volume.detach().cpu().numpy()
    inside = field.is_inside(field.volume).cpu().numpy()
    gray = None if _has_two_values(before, field) else field.detached().cpu().numpy().astype(np.float32)
    after = enforced(inside, gray, wanted, change, field.connectivity, field.grid.spacing)
    if after is None:
        asked = f"{plural(pieces, 'piece')}, {plural(tunnels, 'tunnel')} and {plural(cavities, 'cavity', 'cavities')}"
        raise InputError(
            f"{shape.name}: no solid with {asked} was found near this one, of which the report has "
            f"{shape.report().solid_betti}. Ask for numbers nearer to these, or for several steps."
        )
    values = _with_values_of_the_nearest(before, inside, after)
    if isinstance(volume, Tensor):
        return torch.from_numpy(values).to(volume)
    if isinstance(volume, np.ndarray):
        return values.astype(volume.dtype, copy=False)
    return from_voxels(
        values,
        level=None if field.labels or field.is_binary else field.level,
        label=field.labels or None,
        connectivity=field.connectivity,
        spacing=field.grid.spacing,
        origin=field.grid.origin,
    ).replace(name=shape.name, notes=shape.notes)


def _has_two_values(volume: NDArray[Any], field: VoxelField) -> bool:
    """Whether all voxels inside are alike, and all outside, so that their values do not say how deep they are."""
    return field.is_binary or bool(((volume == volume.min()) | (volume == volume.max())).all())


def _with_values_of_the_nearest(
    volume: NDArray[Any], before: NDArray[np.bool_], after: NDArray[np.bool_]
) -> NDArray[Any]:
    """The volume with new values where two solids differ: those of the nearest voxel on the other side."""
    values = volume.copy()
    for side in (before, ~before):
        changed = side & (before != after)
        if changed.any():
            nearest = distance_transform_edt(side, return_distances=False, return_indices=True)
            values[changed] = volume[tuple(nearest[:, changed])]
    return values
