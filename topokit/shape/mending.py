"""Methods of `Shape` that change it: without its narrow features, with another topology, and written to a file.

The room of repair knows the adapters of volumes and meshes, and so lies above this one: it is found by its name.
"""

from __future__ import annotations

import os
import pkgutil
from typing import TYPE_CHECKING, Any, Literal

from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.core.homotopy.nearest_solid import Change
    from topokit.losses.topology import TopologyLoss
    from topokit.shape.shape import Shape

Handles = Literal["auto", "cut", "fill", False]


def simplify(
    shape: Shape,
    *,
    below: float,
    handles: Handles = "auto",
    cavities: bool = True,
    components: bool = True,
    boundaries: bool = False,
    out: str | os.PathLike[str] | None = None,
) -> Shape:
    """The shape without its features that are narrower than a width, of the same kind and counted.

    What is left are the features that `features().above(below)` counts. Of the ways to remove a feature the one that
    changes least is taken: a tunnel is filled or its handle cut, a part dropped or joined to another one, a cavity
    filled or its wall opened. The result's `simplification` says what was done, and where.

    A volume stays a volume: voxels change sides, as few as were found (or, of gray values, those nearest to the level),
    and take the value of the nearest voxel on the other side. A function becomes the volume of its values on its grid.
    It is a heuristic: to find the fewest is NP-hard.

    A mesh stays a mesh: it is cut and capped along short loops; other vertices keep their places and their order. Caps
    that would meet other faces are not made (this needs libigl). Parts are dropped and cavities filled if their box is
    narrower; parts are not joined. Points and splats become the mesh of their closed surface.

    A volume that is counted block by block is mended so, into a new file. A feature is removed if the block with its
        surroundings, at least 32 voxels on each side, shows what it is; `simplification.unsettled` has the narrow
        places of which it does not.

    Not differentiable.

    Args:
        below: width in units of length; see `features`. What is as wide or wider stays.
        handles: whether tunnels are removed by "cut", by "fill", by whichever changes less ("auto"), or not (False).
        cavities: whether narrow cavities are removed.
        components: whether narrow parts are removed.
        boundaries: whether the boundary of an open mesh is filled first, however wide; see `fill_boundaries`.
        out: of a volume that is counted block by block, the file to write: .npy, or .zarr, which must not exist.

    Raises:
        InputError: if `below` is not positive, `handles` is something else, everything is narrower, or a mesh, points
            or splats have no closed surface; or `out` is missing for a volume in blocks, or given for another shape.

    Example:
        >>> import numpy as np, topokit as tk
        >>> plate = np.ones((9, 9, 3), dtype=bool)
        >>> plate[4, 4] = False
        >>> mended = tk.from_voxels(plate).simplify(below=2)
        >>> mended.genus(), mended.simplification.changed
        (0, 1)
    """
    made: Shape = pkgutil.resolve_name("topokit.repair.simplify:simplify")(
        shape, below, handles, cavities, components, boundaries, out
    )
    return made


def enforce(shape: Shape, betti: tuple[int, int, int] = (1, 0, 0), *, change: Change = "any") -> Shape:
    """The volume whose solid has given Betti numbers, with as few voxels changed as were found; counted.

    See `topokit.enforce`, which takes and gives arrays. A function becomes the volume of its values on its grid, as in
    `simplify`; to change the function itself, train it with `goal()`. The search is a heuristic, its result exact. Not
    differentiable.

    Args:
        betti: wanted numbers of pieces, tunnels and cavities of the solid.
        change: whether voxels may only be added to the solid ("add"), only removed from it ("remove"), or both ("any").

    Raises:
        InputError: if no solid with these numbers was found, an argument has a wrong value, or the shape was not made
            from a volume in memory or a function.

    Example:
        >>> import numpy as np, topokit as tk
        >>> ring = np.ones((7, 7, 3), dtype=bool)
        >>> ring[3, 3] = False
        >>> tk.from_voxels(ring).enforce((1, 0, 0)).betti().solid
        (1, 0, 0)
    """
    made: Shape = pkgutil.resolve_name("topokit.repair.enforce:enforced_shape")(shape, betti, change)
    return made


def goal(shape: Shape, **options: Any) -> TopologyLoss:
    """A loss that is zero for fields whose solid has the topology of this one: to train the network that it came from.

    Args:
        options: as for `TopologyLoss`, such as `at_most`, `change` or `search_every`.

    Raises:
        InputError: if the Betti numbers of the solid are not known.

    Example:
        >>> import topokit as tk, torch
        >>> axis = torch.linspace(-1, 1, 32)
        >>> x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
        >>> torus = 0.3 - torch.hypot(torch.hypot(x, y) - 0.5, z)
        >>> loss = tk.from_voxels(torus, level=0).enforce((1, 0, 0)).goal()
        >>> bool(loss(torus) > 0)
        True
    """
    betti = shape.report().solid_betti
    if betti is None:
        raise InputError(f"{shape.name}: the Betti numbers of its solid are not known, so they cannot be a goal.")
    made: TopologyLoss = pkgutil.resolve_name("topokit.losses.topology:TopologyLoss")(betti=betti, **options)
    return made


def fill_boundaries(shape: Shape) -> Shape:
    """The mesh with every boundary loop closed by a fan of triangles.

    Vertices keep their places and their order; a vertex at which two boundary loops touch is doubled. What is filled is
    a closed manifold, which is counted before it is returned. Fans suit small holes: over a large and bent boundary
    they can pass through the surface.

    Raises:
        InputError: if the shape was not made from a mesh, or the mesh has edges with three faces or more or cannot be
            oriented.
    """
    made: Shape = pkgutil.resolve_name("topokit.repair.meshes:without_boundaries")(shape)
    return made


def save(shape: Shape, path: str | os.PathLike[str]) -> None:
    """Write the mesh or the volume to a file, with its voxel sizes and its place in the world where the format can.

    Args:
        path: file to write; it appears when it is complete. Meshes: .stl .ply .obj .off .glb. Volumes: .npy .npz .nii
            .nii.gz .nrrd .mha .tif.

    Raises:
        InputError: if the shape is neither a mesh nor a volume in memory, the file is called otherwise or its folder
            does not exist, or the format has no values of this type.
        MissingDependencyError: if the format's writer is not installed.

    Example:
        >>> import numpy as np, tempfile, topokit as tk
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     tk.from_voxels(np.ones((3, 3, 3))).save(f"{folder}/cube.npy")
        ...     tk.load(f"{folder}/cube.npy").n_components
        1
    """
    pkgutil.resolve_name("topokit.repair.files:save")(shape, path)
