"""`Shape.simplify`: any representation without its narrow features, as a shape of the same kind."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from numbers import Real

from topokit.adapters.voxels.larger_than_memory import StoredSolid
from topokit.core.homotopy.simplified import Way
from topokit.errors import InputError
from topokit.repair.in_blocks import simplified_in_blocks
from topokit.repair.meshes import simplified_mesh, without_boundaries
from topokit.repair.volumes import simplified_volume
from topokit.shape import Shape
from topokit.shape.mending import Handles

_OF_HANDLES: dict[object, frozenset[Way]] = {
    "auto": frozenset({("tunnel", "cut"), ("tunnel", "filled")}),
    "cut": frozenset({("tunnel", "cut")}),
    "fill": frozenset({("tunnel", "filled")}),
    False: frozenset(),
}
_OF_CAVITIES: frozenset[Way] = frozenset({("cavity", "filled"), ("cavity", "opened")})
_OF_COMPONENTS: frozenset[Way] = frozenset({("part", "dropped"), ("part", "joined")})


def simplify(
    shape: Shape,
    below: float,
    handles: Handles,
    cavities: bool,
    components: bool,
    boundaries: bool,
    out: str | os.PathLike[str] | None,
) -> Shape:
    """The shape without features narrower than a width; see `Shape.simplify`."""
    if not (isinstance(below, Real) and not isinstance(below, bool) and 0 < below < math.inf):
        raise InputError(f"below is {below!r}; a positive width in units of length was expected.")
    if not isinstance(handles, str | bool) or handles not in _OF_HANDLES:
        raise InputError(f"handles is {handles!r}; 'auto', 'cut', 'fill' or False was expected.")
    ways = _OF_HANDLES[handles]
    ways |= _OF_CAVITIES if cavities else frozenset()
    ways |= _OF_COMPONENTS if components else frozenset()
    if isinstance(shape.stored, StoredSolid):
        if out is None:
            raise InputError(f"{shape.name} is counted block by block: pass out, the .npy or .zarr to write.")
        return simplified_in_blocks(shape, shape.stored, float(below), ways, out)
    if out is not None:
        raise InputError(f"{shape.name} is in memory: leave out=… away, and save() what comes back.")
    n_filled = 0
    if boundaries and shape.mesh is not None and not shape.is_closed:
        n_filled, shape = len(shape.boundaries()), without_boundaries(shape)
    made = (simplified_mesh if shape.field is None else simplified_volume)(shape, float(below), ways)
    if made.simplification is None:
        raise AssertionError(f"{made.name}: nothing says what was removed")
    return made.replace(simplification=replace(made.simplification, filled=n_filled))
