"""Point clouds, with or without normals."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from topokit.adapters.points.files import read_points
from topokit.adapters.points.large import FEW, reduced_samples, stored_cloud
from topokit.adapters.points.ragged import checked_lengths, is_nested, padded, without_padding
from topokit.core.cloud.sampling.copies import places
from topokit.core.local.neighborhood_size import given_or_default
from topokit.core.residence import stays_on_device
from topokit.core.samples import SurfaceSamples, largest_coordinate
from topokit.errors import InputError
from topokit.inputs.arrays import as_floating, is_array
from topokit.inputs.files import existing_file
from topokit.inputs.objects import is_frame, points_of
from topokit.inputs.remote import takes_addresses
from topokit.inputs.unpacking import unpacked
from topokit.shape import Shape


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
        positions, directions = _valid_rows(positions, directions, notes)
    samples = SurfaceSamples(positions, directions, lengths=sizes)
    if is_checked:
        samples = _one_per_place(samples, given_or_default(n_neighbors), notes)
    shape = Shape(samples, name=name, notes=tuple(notes), n_neighbors=n_neighbors)
    if is_checked:
        _check_places(positions.detach())
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


def _check_places(points: Tensor) -> None:
    if bool((points == points[0]).all()):
        raise InputError(f"all {len(points)} points are at {tuple(points[0].tolist())}: they sample no surface.")


def _valid_rows(points: Tensor, normals: Tensor | None, notes: list[str]) -> tuple[Tensor, Tensor | None]:
    """Rows with finite points and, where normals are kept, valid normals; what is dropped is noted."""
    finite, what_else = _usable(points.detach())
    n_dropped = int((~finite).sum())
    if n_dropped:
        what = f"{n_dropped} of {len(points)} points are {what_else}"
        if 2 * n_dropped > len(points):
            raise InputError(
                f"{what}. More than half of the cloud is invalid: keep the finite rows yourself to use them."
            )
        notes.append(f"{what} and were dropped.")
        points = points[finite]
        normals = None if normals is None else normals[finite]
    if normals is None:
        return points, None
    valid = torch.isfinite(normals.detach()).all(-1) & (normals.detach() != 0).any(-1)
    n_invalid = int((~valid).sum())
    if n_invalid == 0:
        return points, normals
    what = f"{n_invalid} of {len(points)} normals are zero or not finite"
    if n_invalid > FEW * len(points):
        notes.append(f"{what}; all normals were ignored.")
        return points, None
    notes.append(f"{what}; their points were dropped.")
    return points[valid], normals[valid]


def _one_per_place(samples: SurfaceSamples, n_neighbors: int, notes: list[str]) -> SurfaceSamples:
    """The mean of the points at each place, and of their normals up to sign; what is merged is noted.

    A cloud with too few places for its neighbors stays as it is: it is no surface, and its report says why.
    """
    points, normals = samples.points, samples.normals
    directions = None if normals is None else normals.detach().double().numpy()
    kept, owner = (torch.from_numpy(index) for index in places(points.detach().double().numpy(), directions))
    if len(kept) == len(points) or len(kept) <= n_neighbors:
        return samples
    notes.append(f"{len(points) - len(kept)} of {len(points)} points repeat others and were merged with them.")
    merged = _means(points, kept, owner)
    if normals is None:
        return SurfaceSamples(merged)
    is_opposite = (normals.detach() * normals.detach()[kept][owner]).sum(-1, keepdim=True) < 0
    return SurfaceSamples(merged, _means(torch.where(is_opposite, -normals, normals), kept, owner))


def _means(values: Tensor, kept: Tensor, owner: Tensor) -> Tensor:
    """Mean of the rows (N, 3) of each owner; equal rows have exactly their value."""
    base = values.detach()[kept]
    weight = (1 / torch.bincount(owner).to(values))[owner, None]
    return base.index_add(0, owner, weight * (values - base[owner]))


def _usable(points: Tensor) -> tuple[Tensor, str]:
    """Which rows are finite, and so near that squares are finite, too; and what the others are."""
    finite = points.isfinite().all(-1)
    if not points.is_floating_point():
        return finite, "NaN or infinite"
    near = (points.abs() <= largest_coordinate(points.dtype)).all(-1)
    n_far = int((finite & ~near).sum())
    if n_far == 0 or 2 * n_far > len(points):  # a whole cloud in such units is refused as one
        return finite, "NaN or infinite"
    return near, f"NaN, infinite or so far off that their squares leave {points.dtype}"
