"""Volumes: exact topology under a stated connectivity, and a field with trainable gray values."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from topokit.adapters.voxels.chosen_part import ALL, Entry, axis_names, volume_index
from topokit.adapters.voxels.counting import Solid
from topokit.adapters.voxels.entry import ADDRESSES, VOXELS
from topokit.adapters.voxels.field import Labels, VoxelField, listed
from topokit.adapters.voxels.files import read_volume
from topokit.adapters.voxels.larger_than_memory import blocks_of, shape_in_blocks
from topokit.adapters.voxels.medical import image_of
from topokit.adapters.voxels.opening_stored import stored_volume
from topokit.adapters.voxels.periodic_or_cut_out import Edges, Ends, cut_out_answer, periodic_answer, periodic_shape
from topokit.adapters.voxels.samples import volume_samples
from topokit.core.arrays import Booleans
from topokit.core.blocks.part import Periodic
from topokit.core.blocks.periodic import count_periodic
from topokit.core.blocks.whole import CountedVolume, count_solid
from topokit.core.components import Corner
from topokit.core.draws import check_sample_count, deferred_seed
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, check_connectivity, comparable
from topokit.core.grid.grid import Spacing
from topokit.core.grid.minkowski import cube_counts
from topokit.core.grid.placement import Index, Placement
from topokit.core.local.neighborhood_size import given_or_default
from topokit.errors import InputError, Option
from topokit.inputs.arrays import as_positions, as_tensor
from topokit.inputs.calls import options_by_name
from topokit.inputs.files import existing_file, user_path
from topokit.inputs.remote import lies_in, takes_addresses
from topokit.inputs.unpacking import unpacked
from topokit.report.counted import CountedAnswer
from topokit.report.volume import volume_answer
from topokit.shape import Shape


@options_by_name("level")
@takes_addresses(ADDRESSES)
def from_voxels(
    volume: str | os.PathLike[str] | Tensor | ArrayLike,
    *,
    spacing: float | Spacing | None = None,
    level: float | None = None,
    connectivity: int = DEFAULT_CONNECTIVITY,
    label: float | tuple[float, ...] | None = None,
    origin: Corner = (0.0, 0.0, 0.0),
    n_samples: int = 10_000,
    starts: Tensor | ArrayLike | None = None,
    n_neighbors: int | None = None,
    generator: torch.Generator | None = None,
    dataset: str | None = None,
    axis: int | str | None = None,
    channel: int | None = None,
    block_voxels: int | None = None,
    client: Any = None,
    periodic: bool | Periodic = False,
    edges: Edges = "solid",
) -> Shape:
    """The surface of the solid {volume > level}, or of the voxels with some label, with its exact topology.

    Outside the volume there is only background: objects cut by the border are closed there, and the report says so.
    `report()` counts; the smoothed χ with τ = 0 is the exact one, too, in little more than the volume's own memory.
    `curvature()` and `gauss_bonnet()` use samples of the volume smoothed over one voxel.

    Both are differentiable in the gray values if these are a floating-point tensor that requires a gradient, also in
    those of a binary volume; the level is held fixed, and so are the values outside the volume. Samples move along
    their normals as the level set of the smoothed volume does (implicit function theorem), and which samples are drawn
    is held fixed: a new shape draws anew unless it has `starts`. Labels, booleans and integers have no gradient.

    A volume that is stored in chunks or as a memory map and has more than 2²⁷ voxels is counted block by block, with
    the same result, and never held as a whole: its shape has a report, but no samples.

    Args:
        volume: (X, Y, Z) tensor or array of any real type, which is not copied where its type allows that, and of which
            further axes of length one are left out; a path (.npy .npz .nii .nrrd .tif .mha .dcm .zarr .h5 .vti, or
            the folder of a DICOM series, or of TIFF slices, which are stacked along the first axis); or an image of
            nibabel, SimpleITK, MONAI or xarray. An array of zarr, h5py, Dask or TensorStore, or a `numpy.memmap`, is
            read block by block if it is large.
        spacing: size of a voxel along each axis of the array, one number or three; by default the file's own, else 1.
        level: voxels strictly above it are inside. Needed unless the volume is binary (then half of its higher value).
        connectivity: 6 (voxels of the solid join through faces) or 26 (also through edges and corners). The background
            has the other one. On real volumes the two answers differ grossly.
        label: voxels equal to it, or to one of several, are inside; then there is no level.
        origin: position of the center of the first voxel, in the units of the spacing.
        n_samples: number of samples.
        starts: (N, 3) points near the surface, such as the samples of the last training step. They become the samples,
            moved along the gradient by at most two voxels; those too far away are left out. Parts of the surface
            without starts are not seen, and the samples grow uneven: leave starts out now and then.
        n_neighbors: number of nearest neighbors for curvature; None takes 20, or more where the samples are noisy.
        generator: source of randomness; a seed is drawn from it at once. Seed 0 if None.
        dataset: path of the array in a zarr group, HDF5 or VTK file that holds several.
        axis: name or number of the axis along which `channel` is chosen, such as "t". Arrays of xarray, zarr, OME-Zarr
            and HDF5 may name their axes; by default the one that is named "c" or "channel".
        channel: which of several channels, or times, of an array with a fourth axis is the volume, from 0 on.
        block_voxels: count block by block, whatever the volume's size, with at most so many voxels in a block; but a
            block has at least one chunk of the storage. By default 2²⁴.
        client: a `dask.distributed.Client` whose workers count the blocks; by default this process, one by one, but for
            Dask arrays the client that is active.
        periodic: along which axes the last layer touches the first, as in a cell of a lattice; one for all or three.
            Pieces, tunnels, cavities and the genus of the surface are then those in the torus, where a loop around the
            box is a tunnel and a sheet across it adds a cavity. The shape has a report, but no samples.
        edges: "solid" closes the solid where the volume ends. "cut-out" takes the volume for a box cut out of a larger
            body: the report has its contribution Δχ to χ of that body, `cut_out_euler`, and `connectivity_density`.
            Boxes that share their end layers, `volume[:65]` and `volume[64:]`, add up to the whole.

    Raises:
        ReadError: if the file is missing or malformed.
        MissingDependencyError: if the file's reader is not installed.
        InputError: on wrong shapes, types, spacing, origin, level, label or connectivity, if a level is needed, or if
            no voxel is inside.

    Example:
        >>> import numpy as np, topokit as tk
        >>> ring = np.ones((5, 5, 3), dtype=bool)
        >>> ring[2, 2] = False
        >>> tk.from_voxels(ring).report().genus
        1
    """
    check_connectivity(connectivity)
    check_sample_count(n_samples, given_or_default(n_neighbors))
    level = None if level is None else as_number("level", level)
    labels = as_labels(label)
    check_choice(level, labels)
    positions = None if starts is None else as_positions(starts, "starts")
    ends = Ends.of(periodic, edges)
    entry = Entry(dataset, axis, channel)
    if (blocks := blocks_of(volume, entry, block_voxels, client)) is not None:
        place, solid = placed(blocks.volume.placement, spacing, origin), Solid(level, labels, connectivity)
        return shape_in_blocks(blocks, place, place.grid(blocks.volume.shape), solid, n_neighbors, ends)
    name, values, found, given_type = open_volume(volume, entry)
    sampling = Sampling(n_samples, deferred_seed(generator), positions, n_neighbors)
    place, solid = placed(found, spacing, origin), Solid(level, labels, connectivity)
    return shape_in_memory(name, values, place, solid, sampling, ends=ends, given_type=given_type)


class Sampling(NamedTuple):
    """How a volume is sampled: `n_samples`, the seed of the draw, `starts` and `n_neighbors` of `from_voxels`."""

    n_samples: int
    seed: int
    starts: Tensor | None
    n_neighbors: int | None


def shape_in_memory(
    name: str,
    values: Tensor,
    placement: Placement,
    solid: Solid,
    sampling: Sampling,
    first: Index = (0, 0, 0),
    ends: Ends | None = None,
    given_type: torch.dtype | None = None,
) -> Shape:
    """The shape of a volume in memory, or of a box of it.

    Args:
        name: what to call it.
        values: (X, Y, Z).
        placement: of the whole volume.
        solid: what is inside.
        sampling: how to sample it.
        first: index in the whole volume of the first of the values.
        ends: what there is at its ends; background if None.
        given_type: in which the values came, and are saved; their own if None.
    """
    ends = ends or Ends()
    seen = solid.seen(values)
    notes = solid.check(seen)
    level = solid.level
    if level is None:
        level = 0.0 if solid.labels or values.dtype == torch.bool else seen.high / 2
    grid, is_cut_out = placement.grid(values.shape, first), ends.edges == "cut-out"
    field = VoxelField(values, level, solid.labels, grid, solid.connectivity, placement, is_cut_out, given_type)

    def inside() -> Booleans:
        return field.is_inside(field.volume).cpu().numpy()

    def count_torus() -> CountedAnswer:
        started = time.perf_counter()
        found = count_periodic(inside(), field.connectivity, ends.periodic)
        return periodic_answer(found, field.connectivity, ends.periodic, placement, time.perf_counter() - started)

    def count() -> CountedAnswer:
        answer = counted_answer(
            lambda: count_solid(field.volume, field.is_inside, field.connectivity, field.grid), field, placement
        )
        if is_cut_out:
            return cut_out_answer(answer, cube_counts(inside()), field.connectivity, field.grid)
        return answer

    if ends.is_periodic:
        return periodic_shape(name, count_torus, notes)

    return sampled_shape(name, field, count, sampling, notes)


def sampled_shape(
    name: str, field: VoxelField, count: Callable[[], CountedAnswer], sampling: Sampling, notes: tuple[str, ...]
) -> Shape:
    """The shape of a volume in memory, given how it is counted and sentences about its values."""
    n_samples, seed, starts, n_neighbors = sampling
    return Shape(
        lambda: volume_samples(field.values(), field.grid, n_samples, torch.Generator().manual_seed(seed), starts),
        count,
        surface=field.surface,
        field=field,
        name=name,
        notes=notes,
        n_neighbors=n_neighbors,
    )


def counted_answer(count: Callable[[], CountedVolume], field: VoxelField, placement: Placement) -> CountedAnswer:
    """The answer of a count, with the time that it takes."""
    started = time.perf_counter()
    counted = count()
    return volume_answer(counted, field.connectivity, placement, time.perf_counter() - started)


class VolumeInMemory(NamedTuple):
    """A volume in memory.

    Attributes:
        name: what to call it.
        values: (X, Y, Z), of a type that torch can compare.
        placement: where they are, if the file says it.
        given_type: in which they came.
    """

    name: str
    values: Tensor
    placement: Placement | None
    given_type: torch.dtype


def open_volume(volume: str | os.PathLike[str] | Tensor | ArrayLike, entry: Entry) -> VolumeInMemory:
    """The values of a volume, and what is known about them."""
    name, placement, names = "voxels", None, axis_names(volume)
    if isinstance(volume, str | os.PathLike) and not lies_in(volume, ADDRESSES):
        path = user_path(volume)
        path = path if path.is_dir() and VOXELS.can_open(path) else existing_file(path)
        with unpacked(path) as plain:
            stored = stored_volume(plain, entry)
            volume, placement = read_volume(plain, entry) if stored is None else (stored.whole(), stored.placement)
            name, entry = path.name, ALL
    elif (stored := stored_volume(volume, entry)) is not None:
        volume, placement = stored.whole(), stored.placement
        name, entry = stored.name, ALL
    elif (found := image_of(volume, entry)) is not None:
        volume, placement, names = found
    values = as_tensor(volume, "the volume", "(X, Y, Z)")
    values = values[volume_index(values.shape, entry, names)]
    return VolumeInMemory(name, _compared(values), placement, values.dtype)


def _compared(values: Tensor) -> Tensor:
    if values.dtype == torch.uint64:
        values = values.view(torch.int64)
        if bool((values < 0).any()):
            raise InputError("the volume is uint64 with values from 2⁶³ on, which have no order here: convert it.")
    return comparable(values)


def placed(found: Placement | None, spacing: float | Spacing | None, origin: Corner) -> Placement:
    """Where the voxels of a volume are, by its file unless a spacing is given, which then has no world coordinates."""
    place = (found or Placement((1.0, 1.0, 1.0))) if spacing is None else Placement(_as_spacing(spacing))
    return replace(place, spacing=_as_spacing(place.spacing), origin=_as_position(origin))


def _as_spacing(spacing: float | Spacing) -> Spacing:
    """Three positive numbers, or an `InputError`."""
    try:
        steps = np.broadcast_to(np.asarray(spacing, dtype=float), 3)
    except (TypeError, ValueError) as error:
        raise InputError(f"spacing must be one number or three, got {spacing!r}.") from error
    if not (np.isfinite(steps).all() and (steps > 0).all()):
        raise InputError(f"spacing must be positive, got {spacing!r}.")
    return float(steps[0]), float(steps[1]), float(steps[2])


def _as_position(origin: Corner) -> Corner:
    """Three finite numbers, or an `InputError`."""
    try:
        x, y, z = (float(value) for value in origin)
    except (TypeError, ValueError) as error:
        raise InputError(f"origin must be three numbers, got {origin!r}.") from error
    if not np.isfinite((x, y, z)).all():
        raise InputError(f"origin must be finite, got {origin!r}.")
    return x, y, z


def as_number(name: str, value: object) -> float:
    if isinstance(value, Integral):
        return int(value)
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{name} must be one number, got {value!r}.") from error


def as_labels(label: object) -> Labels:
    """None, one number or several as numbers without repetition, in ascending order."""
    if label is None:
        return ()
    if isinstance(label, str) or not isinstance(label, Iterable) or getattr(label, "ndim", 1) == 0:
        return (as_number("label", label),)
    labels = tuple(sorted({as_number("each label", one) for one in label}))
    if not labels:
        raise InputError("label is empty; expected one label or several.")
    return labels


def check_choice(level: float | None, labels: Labels) -> None:
    """An `InputError` if both a level and labels are given."""
    if labels and level is not None:
        given = "both ", Option("level", f"{level}"), " and ", Option("label", listed(labels)), " were given"
        raise InputError(*given, "; one of them says what is inside.")
