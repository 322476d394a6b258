"""Point clouds, with or without normals."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike
from torch import Tensor

from topokit.adapters.points.files import read_points
from topokit.adapters.points.invalid_rows import valid_rows
from topokit.adapters.points.larger_than_memory import reduced_samples, stored_cloud
from topokit.adapters.points.ragged import checked_lengths, is_nested, padded, without_padding
from topokit.adapters.points.repeated_points import one_per_place, require_places
from topokit.core.local.neighborhood_size import given_or_default
from topokit.core.residence import stays_on_device
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.inputs.arrays import as_floating, is_array
from topokit.inputs.calls import options_by_name
from topokit.inputs.files import existing_file
from topokit.inputs.objects import is_frame, points_of
from topokit.inputs.remote import takes_addresses
from topokit.inputs.unpacking import unpacked
from topokit.shape import Shape


@options_by_name("n_neighbors")
@takes_addresses()
def from_points(
    points: str | os.PathLike[str] | Tensor | ArrayLike | Any,
    normals: Tensor | ArrayLike | None = None,
    *,
    lengths: Tensor | Sequence[int] | None = None,
    n_neighbors: int | None = None,
    regularize: bool = False,
    block_points: int | None = None,
    client: Any = None,
) -> Shape:
    """A point cloud as a shape.

    A file (.las .laz .parquet .ply .npy and text) or memory map of more than 2²⁴ points is read block by block and
    never held as a whole. Of each cell of a grid at most one point is kept, two million in all at most, and they are
    the samples of the shape: `report()` examines them as it does other clouds. Which ones does not depend on the
    blocks or on who reads them.

    Args:
        points: (..., N, 3) tensor or array; a nested tensor of clouds (Nᵢ, 3); a path (.xyz .txt .csv .pwn .npy .npz
            .ply .pcd .las .laz .e57 .parquet .obj); a data frame with columns x, y, z and perhaps nx, ny, nz; or a
            point cloud of open3d, trimesh, PyTorch3D, PyVista or vedo, with its normals if it has any; or a mesh of
            these, for its vertices alone. Tensors and objects with `__dlpack__` keep device, memory and floating type
            (half precision is widened to float32), and tensors their gradient; other arrays become float64.
        normals: (..., N, 3), outward, any positive length. If None, `report()` finds them with their signs, and
            `curvature()` estimates them by quadrics, or by local PCA on request. Rows whose normal is zero or not
            finite are dropped if they are at most 1 %; otherwise all normals are ignored. The report notes either.
        lengths: (...) number of points of each cloud of a batch of clouds of different size, where the rows after them
            are padding, whose values do not matter. Nested tensors bring their own.
        n_neighbors: number of nearest neighbors for curvature; None takes 20, or more where the samples are noisy.
        regularize: whether to take noise out of points and normals by `Shape.regularized`; without normals this finds
            their signs first, which takes as long as a report.
        block_points: read block by block, whatever the cloud's size, with about so many points in a block. By default
            2²².
        client: a `dask.distributed.Client` whose workers read the blocks; by default this process, one by one.

    Returns:
        A `Shape`, differentiable in points and normals. On the CPU rows that are not finite are dropped, and points
        that repeat others are merged: those at one position, and where many have copies that are ten times nearer to
        each other than to any other point, these too. The mean stands for them, with the mean of their normals up to
        sign, and its gradient is shared among them; the report counts both, and `samples` has fewer rows, which are
        copies that do not follow later changes in place. On accelerators, and in batches, all rows stay: NaN in gives
        NaN out, and `report` refuses it.

    Raises:
        ReadError: if the file is missing or malformed.
        InputError: on wrong shapes or integer tensors, if most rows are not finite, if too few remain, or if all
            points of a cloud on the CPU coincide.

    Example:
        >>> import topokit as tk, torch
        >>> points = torch.randn(2000, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
        >>> sphere = points / points.norm(dim=-1, keepdim=True)
        >>> round(float(tk.from_points(sphere, normals=sphere).gauss_bonnet()))
        2
    """
    if (stored := stored_cloud(points, block_points, client)) is not None:
        if normals is not None or lengths is not None:
            raise InputError(f"{stored.path.name} is read block by block, so normals and lengths cannot be given.")
        samples, sentences = reduced_samples(stored, block_points, client)
        shape = Shape(samples, name=stored.path.name, notes=sentences, n_neighbors=n_neighbors)
        return shape.regularized() if regularize else shape
    name = "points"
    notes: list[str] = []
    if isinstance(points, str | os.PathLike):
        path = existing_file(points)
        with unpacked(path) as plain:
            name, (points, own_normals) = path.name, read_points(plain)
        normals = own_normals if normals is None else normals
    elif is_frame(points) or not (is_array(points) or isinstance(points, list | tuple)):
        points, own_normals = _of_object(points)
        normals = own_normals if normals is None else normals
    if is_nested(points) or is_nested(normals):
        points, normals, lengths = _unnested(points, normals, lengths)
    positions = _tensor(points, "points")
    directions = None if normals is None else _tensor(normals, "normals").to(positions)
    if directions is not None and directions.shape != positions.shape:
        raise InputError(
            f"normals must have the shape of the points, {tuple(positions.shape)}, got {tuple(directions.shape)}."
        )
    sizes = None if lengths is None else checked_lengths(lengths, positions, given_or_default(n_neighbors) + 1)
    if sizes is not None:
        positions, directions = without_padding(positions, directions, sizes)
    is_checked = positions.ndim == 2 and not stays_on_device(positions)
    if is_checked:
        positions, directions = valid_rows(positions, directions, notes)
    samples = SurfaceSamples(positions, directions, lengths=sizes)
    if is_checked:
        samples = one_per_place(samples, given_or_default(n_neighbors), notes)
    shape = Shape(samples, name=name, notes=tuple(notes), n_neighbors=n_neighbors)
    if is_checked:
        require_places(positions.detach())
    return shape.regularized() if regularize else shape


def _tensor(values: object, name: str) -> Tensor:
    tensor = as_floating(values, name, "(N, 3)")
    if tensor.ndim < 2 or tensor.shape[-1] != 3:
        raise InputError(
            f"{name} must have shape (N, 3), or (..., N, 3) for batches, got {tuple(tensor.shape)}.{_columns(tensor)}"
        )
    return tensor


def _columns(tensor: Tensor) -> str:
    """What to do with a table of another shape that is often meant to be points, or nothing."""
    if tensor.ndim == 2 and len(tensor) == 3:
        return " Transpose it."
    if tensor.ndim == 2 and tensor.shape[1] == 6:
        return " Normals are the second argument, from_points(a[:, :3], a[:, 3:]); leave colors out, a[:, :3]."
    return ""


def _unnested(points: object, normals: object, lengths: object) -> tuple[Tensor, Tensor | None, list[int]]:
    """Nested points, and normals if there are any, as padded batches; and the number of points of each cloud."""
    if not is_nested(points) or not (normals is None or is_nested(normals)):
        raise InputError("of points and normals one is a nested tensor and the other is not: nest both, or neither.")
    if lengths is not None:
        raise InputError("nested tensors bring the lengths of their clouds: leave lengths out.")
    positions, sizes = padded(points, "points")
    if normals is None:
        return positions, None, sizes
    directions, others = padded(normals, "normals")
    if others != sizes:
        raise InputError(f"normals must be as many as the points of each cloud, {sizes}, got {others}.")
    return positions, directions, sizes


def _of_object(source: object) -> tuple[Any, Any | None]:
    found = points_of(source)
    if found is None:
        raise InputError(
            f"from_points got {type(source).__name__}; expected a path, a tensor or array (N, 3), anything with "
            "__dlpack__ or __array__, a data frame, or a point cloud of open3d, trimesh, PyTorch3D, PyVista or vedo."
        )
    return found
