"""Euler characteristic of a field on a 3D grid: exact, voxel by voxel, and smoothed so that it can be differentiated.

A field F of shape (..., X, Y, Z) and a level describe the solid {F > level}; outside the grid there is only background.
Which voxels touch is a choice:

* connectivity 6: voxels are the vertices of a cubical complex; an edge, square or cube belongs to the solid when all of
  its vertices do. Voxels join through faces only, the background also through edges and corners (26).
* connectivity 26: voxels are closed unit cubes and the solid is their union; a face, edge or corner belongs to it when
  any of the voxels around it does. Voxels join through faces, edges and corners, the background through faces only (6).

Each is the dual of the other: with one layer of background added all round,
χ₂₆(solid) = χ₆(padded background) − 1.

As the level t falls, a cell enters {F > t} together with one voxel: the lowest of its vertices (connectivity 6) or the
highest of the voxels around it (26). Assigning each cell to that voxel (a lower-star filtration) gives

    index(v) = sum of (-1)^dim over the cells assigned to v,      χ{F > t} = sum of index(v) over voxels with F(v) > t.

The index vanishes except at the critical points of the field. Weighted with sigmoid(F / tau), it sums to the Euler
characteristic averaged over levels. The index of a binary field, summed over one component, is that component's χ.

References:
    T. Banchoff, "Critical points and curvature for embedded polyhedra", J. Differential Geometry 1, 1967,
    doi:10.4310/jdg/1214428092 (the index). T. Heiss, H. Wagner, "Streaming algorithm for Euler characteristic curves of
    multidimensional images", CAIP 2017, doi:10.1007/978-3-319-64689-3_32 (the count over levels). T. Y. Kong,
    A. Rosenfeld, "Digital topology: introduction and survey", CVGIP 48, 1989, doi:10.1016/0734-189X(89)90147-3
    (dual connectivities).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from numpy.typing import ArrayLike
from torch import Tensor
from torch.nn.functional import pad

from topokit.core.residence import stays_on_device
from topokit.errors import InputError

Compare = Callable[[Tensor, Tensor], Tensor]

DEFAULT_CONNECTIVITY = 26  # of the solid, everywhere: volumes, fields of functions and samples, losses, monitors

_AXES = (-1, -2, -3)  # in this order ties are broken lexicographically
_WIDER = {torch.uint16: torch.int32, torch.uint32: torch.int64}
_SLAB = 1 << 20  # bytes of the field handled at a time: small enough for the cache, large enough to hide a call's cost
_COUNT_SLAB = 1 << 22  # the same for the exact count, whose calls are cheaper
_DEVICE_SLAB = 1 << 26  # the same on accelerators, where each call costs more than a small slab


def check_connectivity(connectivity: int) -> int:
    """The connectivity itself.

    Raises:
        InputError: if it is neither 6 nor 26.
    """
    if connectivity not in (6, 26):
        raise InputError(f"connectivity must be 6 or 26, not {connectivity!r}.")
    return connectivity


def dual_connectivity(connectivity: int) -> int:
    """The connectivity of the background, given that of the solid: 26 for 6 and 6 for 26."""
    return 32 - connectivity


def surface_euler(field: Tensor | ArrayLike, level: float = 0.0, connectivity: int = DEFAULT_CONNECTIVITY) -> Tensor:
    """Exact Euler characteristic of the closed surface of the solid {field > level}: twice that of the solid.

    Arguments, result and errors are those of `solid_euler`.
    """
    return 2 * solid_euler(field, level, connectivity)


def solid_euler(field: Tensor | ArrayLike, level: float = 0.0, connectivity: int = DEFAULT_CONNECTIVITY) -> Tensor:
    """Exact Euler characteristic of the solid {field > level}.

    Memory beyond the field itself is bounded by a few slabs of layers.

    Args:
        field: (..., X, Y, Z), any real dtype but uint64, any device. NaN counts as background.
        level: voxels strictly above it are inside.
        connectivity: 6 or 26, that of the solid; the background has the other one.

    Returns:
        (...) int64 tensor on the field's device.

    Raises:
        InputError: if the field has fewer than three axes, or the connectivity is neither 6 nor 26.
    """
    field = as_grid(field, connectivity)
    total = torch.zeros(field.shape[:-3], dtype=torch.int64, device=field.device)
    if 0 in field.shape[-3:]:  # which torch 2.8 does not pad by nothing
        return total
    for start, stop in _slabs(field, _COUNT_SLAB):
        cells = (field[..., start : stop + 1, :, :] > level).view(torch.uint8)
        ends = int(start == 0), int(stop == field.shape[-3])
        if connectivity == 26:
            cells = pad(1 - cells, (1, 1, 1, 1, *ends), value=1)
        total += _alternating_count(pad(cells, (0, 0, 0, 0, 0, ends[1])))
    return total if connectivity == 6 else total - 1


def critical_index(field: Tensor | ArrayLike, connectivity: int = DEFAULT_CONNECTIVITY) -> Tensor:
    """Change of the solid's Euler characteristic as the falling level passes each voxel.

    Its sum over the voxels with field > t is `solid_euler(field, t)`, for every t. It is +1 where a component
    appears or a disc closes a tunnel or walls off a cavity, -1 where parts join, a handle appears or a cavity fills up,
    other values where several of these happen at once, and 0 elsewhere. Only where it is not 0 does `smoothed_euler`
    have a gradient.

    Ties are broken by position, so a plateau is no more critical than a slope: of two equal voxels the one with the
    lexicographically smaller (x, y, z) counts as lower for connectivity 6, as higher for connectivity 26.

    Args:
        field: (..., X, Y, Z), any real dtype but uint64, without NaN, any device; detached, as the index is an integer.
        connectivity: 6 or 26, that of the solid.

    Returns:
        (..., X, Y, Z) int8 tensor on the field's device.

    Raises:
        InputError: if the field has fewer than three axes, or the connectivity is neither 6 nor 26.
    """
    field = as_grid(field, connectivity).detach()
    if field.dtype == torch.bool:
        field = field.view(torch.uint8)
    index = torch.empty(field.shape, dtype=torch.int8, device=field.device)
    for start, stop in _slabs(field, _SLAB):
        first = max(start - 1, 0)  # the index depends on the 26 neighbors: one more layer on either side is enough
        slab = _slab_index(field[..., first : stop + 1, :, :], connectivity)
        index[..., start:stop, :, :] = slab.narrow(-3, start - first, stop - start)
    return index


def smoothed_euler(
    field: Tensor, tau: float | Tensor, level: float = 0.0, connectivity: int = DEFAULT_CONNECTIVITY
) -> Tensor:
    """Euler characteristic of the *surface* of {field > t}, averaged over t ~ Logistic(level, tau); differentiable.

    This is 2 sum over cells of (-1)^dim sigmoid((f(cell) - level) / tau), f(cell) being the value at which the cell
    enters, evaluated as 2 sum over voxels of critical_index * sigmoid((field - level) / tau). As tau goes to 0 it tends
    to 2 `solid_euler(field, level)`, provided that no value lies on the level.

    The derivative is taken at fixed index: exact where the values around a voxel differ; among equal values the whole
    derivative of a cell goes to one voxel, in the order that `critical_index` states. Autograd sees a product and a
    sum only, so higher derivatives and `torch.compile(fullgraph=True)` work.

    Args:
        field: (..., X, Y, Z) floating-point tensor, high inside, on any device. Half precisions are computed in float32
            (their gradient has the field's own dtype: float16 overflows when tau is below about 1e-5). Infinite
            values are allowed and have gradient 0; NaN gives NaN.
        tau: scale of the levels, positive: a number, or a tensor that broadcasts with the batch axes (...). Where it
            needs a gradient the field must be finite.
        level: center of the levels.
        connectivity: 6 or 26, that of the solid.

    Returns:
        (...) tensor on the field's device, of the field's dtype or float32 if that is a half precision.

    Raises:
        InputError: if the field is not a floating-point tensor or has fewer than three axes, the connectivity is
            neither 6 nor 26, or tau is a number and not positive.
    """
    if not isinstance(field, Tensor) or not field.is_floating_point():
        kind = field.dtype if isinstance(field, Tensor) else type(field).__name__
        raise InputError(f"the smoothed Euler characteristic needs a floating-point tensor, not {kind}.")
    if isinstance(tau, Tensor):
        tau = tau[..., None, None, None]
    elif not tau > 0:
        raise InputError(f"tau must be positive, not {tau}.")
    index = critical_index(field, connectivity)
    layers = _slab_layers(field, _SLAB)
    total = torch.zeros((), device=field.device)
    for values, indices in zip(field.split(layers, -3), index.split(layers, -3), strict=True):
        total = total + (indices * torch.sigmoid((at_least_single(values) - level) / tau)).sum(_AXES)
    return 2 * total


def as_grid(field: Tensor | ArrayLike, connectivity: int) -> Tensor:
    """The field as a tensor that torch can compare and order; shared memory where its dtype allows it.

    Args:
        field: (..., X, Y, Z). The unsigned dtypes that torch cannot compare, uint16 and uint32, are widened.
        connectivity: 6 or 26.

    Raises:
        InputError: if the field has fewer than three axes, or the connectivity is neither 6 nor 26.
    """
    field = torch.as_tensor(field)
    if field.dim() < 3:
        raise InputError(f"a field on a grid has shape (..., X, Y, Z), not {tuple(field.shape)}.")
    check_connectivity(connectivity)
    return comparable(field)


def comparable(values: Tensor) -> Tensor:
    """The values, widened if torch cannot compare and order their dtype: uint16 and uint32."""
    return values.to(_WIDER.get(values.dtype, values.dtype))


def at_least_single(values: Tensor) -> Tensor:
    """The values, in float32 if they came in a half precision."""
    return values if values.dtype.itemsize >= 4 else values.float()


def _alternating_count(cells: Tensor, axes: tuple[int, ...] = (-1, -2)) -> Tensor:
    """Vertices - edges + squares - cubes that start in all layers but the last, of at most 255 layers of 0 and 1."""
    if not axes:  # along the remaining axis, vertices - edges = ends of runs of ones
        ends = cells[..., :-1, :, :] > cells[..., 1:, :, :]
        return ends.view(torch.uint8).sum(-3, dtype=torch.uint8).sum((-2, -1))  # bytes are fast, and large enough
    lower, upper = _neighbors(cells, axes[0])
    return _alternating_count(cells, axes[1:]) - _alternating_count(lower & upper, axes[1:])


def _slab_index(field: Tensor, connectivity: int) -> Tensor:
    """Critical index of a slab, as if there were nothing beyond it."""
    if connectivity == 6:
        return _lower_star_index(field, torch.minimum, torch.le, _AXES)
    lowest = float("-inf") if field.is_floating_point() else torch.iinfo(field.dtype).min
    padded = pad(field, (1,) * 6, value=lowest)
    return -_lower_star_index(padded, torch.maximum, torch.ge, _AXES)[..., 1:-1, 1:-1, 1:-1]


def _lower_star_index(value: Tensor, extreme: Compare, comes_first: Compare, axes: tuple[int, ...]) -> Tensor:
    """Sum of (-1)^dim over the blocks spanned by the axes, each assigned to its voxel of extreme value, as int8."""
    if not axes:
        return torch.ones_like(value, dtype=torch.int8)
    axis, others = axes[0], axes[1:]
    lower, upper = _neighbors(value, axis)
    across = _lower_star_index(extreme(lower, upper), extreme, comes_first, others)
    to_lower = across * comes_first(lower, upper)
    index = _lower_star_index(value, extreme, comes_first, others)
    index_of_lower, index_of_upper = _neighbors(index, axis)
    index_of_lower -= to_lower
    index_of_upper -= across - to_lower
    return index


def _neighbors(tensor: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    """Views of the lower and of the upper voxel of every pair of neighbors along an axis."""
    pairs = max(tensor.shape[axis] - 1, 0)
    return tensor.narrow(axis, 0, pairs), tensor.narrow(axis, tensor.shape[axis] - pairs, pairs)


def _slabs(field: Tensor, size: int) -> Iterator[tuple[int, int]]:
    """First and last + 1 of the layers of each slab."""
    layers, step = field.shape[-3], _slab_layers(field, size)
    return ((start, min(start + step, layers)) for start in range(0, max(layers, 1), step))


def _slab_layers(field: Tensor, size: int) -> int:
    """Layers of `size` bytes together, but at least 16, as slabs overlap, and at most 252, as bytes count them."""
    size = max(size, _DEVICE_SLAB) if stays_on_device(field) else size
    return min(max(size * field.shape[-3] // max(field.nbytes, 1), 16), 252)
