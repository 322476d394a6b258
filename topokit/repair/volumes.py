"""Volumes with some voxels moved into the solid or out of it, and nothing else changed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from topokit.adapters.voxels.adapter import Sampling, shape_in_memory
from topokit.adapters.voxels.counting import Solid
from topokit.adapters.voxels.field import VoxelField
from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.field import Field
from topokit.core.grid.grid import occupied_box
from topokit.core.grid.tiles import tiles_of
from topokit.core.homotopy.simplified import Betti, Block, Simplified, Step, Way, simplified
from topokit.core.removal import KINDS, Removal
from topokit.core.scale.widths import SurfaceWidths
from topokit.errors import InputError
from topokit.report.simplification import Simplification, Unsettled
from topokit.shape import Shape

_SAMPLING = Sampling(10_000, 0, None, None)
_TILE = 16  # voxels along each axis in which the nearest ones are looked for at a time
_MARGIN = 2  # voxels around the solid in which gaps between parts are closed


def simplified_volume(shape: Shape, below: float, ways: frozenset[Way]) -> Shape:
    """A volume without its narrow features; see `Shape.simplify`.

    Args:
        shape: with a field on a grid.
        below: width, in units of length.
        ways: how features may be removed.

    Raises:
        InputError: if the shape was not made from a volume in memory or a function, is cut out of a larger body, or all
            of it is narrower.
    """
    field = voxel_field(shape)
    if field.is_cut_out:
        raise InputError(f'{shape.name} is cut out of a larger body: open it with edges="solid" to change it.')
    inside = field.is_inside(field.volume).cpu().numpy()
    margin = [_MARGIN + int(np.ceil(below / step)) for step in field.grid.spacing]
    sides = occupied_box(torch.from_numpy(inside))
    low = np.array([max(start - more, 0) for (start, _), more in zip(sides, margin, strict=True)])
    box = tuple(slice(a, stop + more) for a, (_, stop), more in zip(low, sides, margin, strict=True))
    found = simplified_field(field, inside, box, below, ways)
    changed = found.changed + low
    was_inside = inside[tuple(changed.T)]
    if int(was_inside.sum()) - int((~was_inside).sum()) == np.count_nonzero(inside):
        raise everything_is_narrower(shape.name, below)
    result = with_solid(shape, field, inside, changed)
    removals = removals_of(found.steps, np.asarray(field.grid.origin) + low * field.grid.spacing, field.grid.spacing)
    after = result.report().solid_betti
    done = counted_simplification(shape.name, below, removals, found.before, after, len(changed), found.narrowest)
    return result.replace(simplification=done, notes=(*shape.notes, done.summary()))


def simplified_field(
    field: VoxelField,
    inside: Booleans,
    box: tuple[slice, ...],
    below: float,
    ways: frozenset[Way],
    block: Block | None = None,
) -> Simplified:
    """The solid in a box of a volume without its narrow features, with widths of its surface.

    Args:
        field: the volume.
        inside: its solid.
        box: what may change.
        below: width, in units of length.
        ways: how features may be removed.
        block: which part of a larger volume it is; None if it is the whole.
    """
    low, spacing = np.array([side.start for side in box]), field.grid.spacing

    def widths(changed: Integers) -> Callable[[Integers], Floats]:
        balls = SurfaceWidths(partial(field.surface_in_boxes, flipped=changed + low), spacing, below)
        return lambda voxels: balls.at(voxels + low)

    return simplified(inside[box], _cost(field, box), below, ways, widths, field.connectivity, spacing, block)


def everything_is_narrower(name: str, below: float) -> InputError:
    """The error that nothing would be left."""
    return InputError(
        f"{name}: every part is narrower than {below:g}, so that nothing would be left: components=False keeps them."
    )


def counted_simplification(
    name: str,
    below: float,
    removals: list[Removal],
    before: Betti,
    after: Betti | None,
    changed: int,
    narrowest: float,
    unsettled: Iterable[Unsettled] = (),
) -> Simplification:
    """What was done to a volume, held against counts."""
    expected = [*before]
    for one in removals:
        expected[KINDS.index(one.kind)] -= 1
    if after is None or tuple(after) != tuple(expected):
        raise AssertionError(f"{name}: {expected} was expected of what was removed, {after} was counted")
    return Simplification.of(below, removals, before, after, changed, "voxel", narrowest, unsettled)


def voxel_field(shape: Shape) -> VoxelField:
    """The voxels of a shape: those of its volume, or the values of its function on the grid of its field.

    Raises:
        InputError: if it has neither.
    """
    field = shape.field
    if isinstance(field, VoxelField):
        return field
    if isinstance(field, Field):
        return VoxelField(field.detached().cpu(), 0.0, (), field.grid, field.connectivity)
    raise InputError(f"{shape.name} was not made from a volume in memory: only the voxels of one can be changed.")


def _cost(field: VoxelField, box: tuple[slice, ...]) -> Floats | None:
    """How far the value of each voxel is from the level; None where values do not say it."""
    if has_two_values(field):
        return None
    depth = np.abs(field.detached()[box].cpu().double().numpy())
    known = np.isfinite(depth)
    return np.where(known, depth, depth[known].max(initial=1.0))


def removals_of(steps: list[Step], origin: Floats, spacing: tuple[float, float, float]) -> list[Removal]:
    """What some steps remove, given the place of the first voxel."""
    found = []
    for step in steps:
        for (kind, how), one in zip(step.ways, step.filled, strict=True):
            x, y, z = (origin + one.voxel * spacing).tolist()
            found.append(Removal(kind, how, one.width, (x, y, z), len(step.voxels)))
    return found


def has_two_values(field: VoxelField) -> bool:
    """Whether all voxels inside are alike, and all outside, so that their values do not say how deep they are."""
    volume = field.volume.detach()
    return field.is_binary or bool(((volume == volume.min()) | (volume == volume.max())).all())


def with_solid(shape: Shape, field: VoxelField, before: Booleans, changed: Integers) -> Shape:
    """A volume of which some voxels changed sides; its name, notes, level, labels and placement are kept.

    Args:
        shape: of the volume.
        field: its voxels.
        before: (X, Y, Z), its solid.
        changed: (N, 3), the voxels, each once.
    """
    volume = field.volume.detach()
    values = with_values_of_the_nearest(volume.cpu().numpy(), before, changed)
    solid = Solid(None if field.is_binary else field.level, field.labels, field.connectivity)
    first, given = field.placement.voxel(field.grid.origin), torch.from_numpy(values).to(volume)
    made = shape_in_memory(shape.name, given, field.placement, solid, _SAMPLING, first, given_type=field.given_type)
    return made.replace(notes=shape.notes, n_neighbors=shape.n_neighbors)


def with_values_of_the_nearest(volume: NDArray[Any], before: Booleans, changed: Integers) -> NDArray[Any]:
    """The volume with new values at voxels (N, 3) that change sides: those of the nearest one on the other side.

    NaN, which is outside, is taken over only if there is no other value outside.
    """
    values = volume.copy()
    if volume.dtype == bool:
        values[tuple(changed.T)] ^= True
        return values
    outside = ~before
    if (known := outside & ~np.isnan(volume)).any():
        outside = known
    for first, rows in tiles_of(changed, _TILE):
        for was_inside, others in ((True, outside), (False, before)):
            voxels = changed[rows][before[tuple(changed[rows].T)] == was_inside]
            if len(voxels):
                values[tuple(voxels.T)] = volume[tuple(_nearest(others, first, voxels).T)]
    return values


def _nearest(others: Booleans, first: Integers, voxels: Integers) -> Integers:
    """The nearest of some voxels (X, Y, Z) to each one (N, 3) in a tile, which is given by its first one."""
    margin = 2
    while True:
        low = np.maximum(first - margin, 0)
        part = ~others[tuple(slice(a, b) for a, b in zip(low, first + _TILE + margin, strict=True))]
        is_whole = part.shape == others.shape
        if is_whole or not part.all():
            away, nearest = distance_transform_edt(part, return_indices=True)
            own = tuple((voxels - low).T)
            if is_whole or away[own].max() <= margin:
                return np.asarray(nearest[(slice(None), *own)].T + low)
        margin *= 2
