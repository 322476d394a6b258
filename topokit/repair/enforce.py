"""Volumes with given Betti numbers, counted before they are returned."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from topokit.adapters.voxels.adapter import from_voxels
from topokit.core.homotopy.enforced import enforced
from topokit.core.homotopy.nearest_solid import Betti, Change
from topokit.errors import InputError
from topokit.repair.volumes import has_two_values, voxel_field, with_solid
from topokit.report.wording import plural
from topokit.shape import Shape


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
        InputError: if no solid with these numbers was found, one of them is no integer of at least 0, the shape was not
            made from a volume in memory or a function, or as for `from_voxels`.

    Example:
        >>> import numpy as np, topokit as tk
        >>> ring = np.ones((7, 7, 3), dtype=bool)
        >>> ring[3, 3] = False
        >>> int((tk.enforce(ring) != ring).sum())  # one voxel closes the tunnel
        1
    """
    shape = volume if isinstance(volume, Shape) else from_voxels(volume, **options)
    made = enforced_shape(shape, (pieces, tunnels, cavities), change)
    if not isinstance(volume, np.ndarray | Tensor):
        return made
    values = voxel_field(made).volume
    return values.to(volume) if isinstance(volume, Tensor) else values.numpy().astype(volume.dtype, copy=False)


def enforced_shape(shape: Shape, betti: Betti, change: Change) -> Shape:
    """The volume of a shape with given Betti numbers; see `Shape.enforce`."""
    if len(betti) != 3 or not all(isinstance(one, int | np.integer) and one >= 0 for one in betti):
        raise InputError(f"pieces, tunnels and cavities are {betti}; three integers of at least 0 were expected.")
    if change not in get_args(Change):
        raise InputError(f"change is {change!r}; expected one of {', '.join(map(repr, get_args(Change)))}.")
    field = voxel_field(shape)
    inside = field.is_inside(field.volume).cpu().numpy()
    gray = None if has_two_values(field) else _finite(field.detached().cpu().numpy().astype(np.float32))
    after = enforced(inside, gray, betti, change, field.connectivity, field.grid.spacing) if inside.any() else None
    if after is None:
        pieces, tunnels, cavities = betti
        asked = f"{plural(pieces, 'piece')}, {plural(tunnels, 'tunnel')} and {plural(cavities, 'cavity', 'cavities')}"
        raise InputError(
            f"{shape.name}: no solid with {asked} was found near this one, of which the report has "
            f"{shape.report().solid_betti}. Ask for numbers nearer to these, or for several steps."
        )
    changed = np.argwhere(after != inside)
    made = with_solid(shape, field, inside, changed)
    told = plural(len(changed), "voxel")
    return made.replace(notes=(*made.notes, f"{told} changed sides, so that the solid has the wanted topology."))


def _finite(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depths with infinite ones, as those of NaN, replaced by the largest of the others."""
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    return np.clip(values, -largest, largest) if largest else np.sign(values)
