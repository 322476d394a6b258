"""Volumes: exact topology under a stated connectivity, and a field whose grey values can be trained."""

from __future__ import annotations

import os
import time

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from topokit.adapters.voxels.files import Spacing, read_volume
from topokit.adapters.voxels.samples import volume_samples
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, comparable, solid_euler
from topokit.core.grid.field import Field
from topokit.core.grid.surfaces import grid_surfaces
from topokit.core.local.curvature import DEFAULT_NEIGHBORS
from topokit.errors import InputError
from topokit.inputs.arrays import as_tensor
from topokit.inputs.files import existing_file
from topokit.report.report import CountedAnswer
from topokit.report.volume import volume_answer
from topokit.shape import Shape

Position = tuple[float, float, float]
_SLAB = 16  # layers looked at together


def from_voxels(
    volume: str | os.PathLike[str] | Tensor | ArrayLike,
    spacing: float | Spacing | None = None,
    level: float | None = None,
    connectivity: int = DEFAULT_CONNECTIVITY,
    label: int | None = None,
    *,
    origin: Position = (0.0, 0.0, 0.0),
    n_samples: int = 10_000,
    n_neighbors: int = DEFAULT_NEIGHBORS,
    generator: torch.Generator | None = None,
) -> Shape:
    """The surface of the solid {volume > level}, or {volume == label}, with its exact topology.

    Outside the volume there is only background: objects cut by the border are closed there, and the report says so.
    `report()` counts; `euler(method="field")` is differentiable in the grey values if these are a floating-point tensor
    (`tau=0` gives the exact integer of χ alone, in little more than the volume's own memory). `curvature()` and
    `euler()` use samples of the volume smoothed over one voxel; these are not differentiable.

    Args:
        volume: (X, Y, Z) tensor or array of any real type, or a path (.npy .npz .nii .nii.gz .nrrd .tif). Not copied
            where its type allows that.
        spacing: size of a voxel along each axis of the array, one number or three; by default the file's own, else 1.
        level: voxels strictly above it are inside. Needed unless the volume is binary (then half of its higher value).
        connectivity: 6 (voxels of the solid join through faces) or 26 (also through edges and corners). The background
            has the other one. On real volumes the two answers differ grossly.
        label: voxels equal to it are inside; then there is no level.
        origin: position of the centre of the first voxel, in the units of the spacing.
        n_samples: number of samples.
        n_neighbors: k of the local half.
        generator: source of randomness (CPU); seed 0 if None.

    Raises:
        ReadError: if the file is missing or malformed.
        MissingDependencyError: if the file's reader is not installed.
        InputError: on wrong shapes, types, spacing, origin or connectivity, if a level is needed, or if no voxel is
            inside.

    Example:
        >>> import numpy as np, topokit as tk
        >>> ring = np.ones((5, 5, 3), dtype=bool)
        >>> ring[2, 2] = False
        >>> tk.from_voxels(ring).report().genus
        1
    """
    name, stored = "voxels", None
    if isinstance(volume, str | os.PathLike):
        path = existing_file(volume)
        name, (volume, stored) = path.name, read_volume(path)
    values = _tensor(volume)
    steps = _spacing(stored if spacing is None else spacing)
    first = _position(origin)
    if connectivity not in (6, 26):
        raise InputError(f"connectivity must be 6 or 26, got {connectivity!r}.")
    if n_samples <= n_neighbors:
        raise InputError(f"n_samples is {n_samples}; it must be larger than n_neighbors, which is {n_neighbors}.")
    level, notes = _level(values, level, label)
    field = VoxelField(values, level, label, steps, connectivity, first)
    if not field.is_anything_inside():
        wanted = f"equals the label {label}" if label is not None else f"is above the level {level:g}"
        low, high = _range(values)
        raise InputError(f"no voxel {wanted}: the volume's values go from {low:g} to {high:g}.")
    generator = generator or torch.Generator().manual_seed(0)
    return Shape(
        lambda: volume_samples(field.values().detach(), steps, first, n_samples, generator),
        lambda: _answer(field),
        field=field,
        name=name,
        notes=notes,
        n_neighbors=n_neighbors,
    )


class VoxelField(Field):
    """Grey values minus their level, or +½ and −½ where the volume is binary or a label is asked for."""

    def __init__(
        self,
        volume: Tensor,
        level: float,
        label: int | None,
        spacing: Spacing,
        connectivity: int,
        origin: Position = (0.0, 0.0, 0.0),
    ) -> None:
        super().__init__(origin, spacing, tuple(volume.shape), connectivity)
        self.volume, self.level, self.label = volume, level, label
        self.is_binary = label is not None or volume.dtype == torch.bool

    def inside(self) -> Tensor:
        """(X, Y, Z) bool."""
        return self.volume == self.label if self.label is not None else self.volume.detach() > self.level

    def is_anything_inside(self) -> bool:
        """Whether the solid has a voxel; looks at a few layers at a time."""
        parts = torch.split(self.volume.detach(), _SLAB)
        return any(bool((part == self.label if self.label is not None else part > self.level).any()) for part in parts)

    def values(self) -> Tensor:
        """See `Field.values`; NaN becomes −∞, which is background whatever the level."""
        if self.is_binary:
            return self.inside().to(torch.get_default_dtype()) - 0.5
        grey = self.volume if self.volume.is_floating_point() else self.volume.to(torch.get_default_dtype())
        return torch.where(grey.isnan(), -torch.inf, grey) - self.level

    def exact_euler(self, connectivity: int | None = None) -> Tensor:
        """See `Field.exact_euler`; counted on the volume as it is, without a copy in floating point."""
        connectivity = connectivity or self.connectivity
        if self.label is not None:
            return 2 * solid_euler(self.inside(), 0, connectivity)
        return 2 * solid_euler(self.volume.detach(), self.level, connectivity)


def _tensor(volume: object) -> Tensor:
    values = as_tensor(volume, "the volume", "(X, Y, Z)")
    if values.ndim != 3 or values.numel() == 0:
        raise InputError(f"the volume must have shape (X, Y, Z), got {tuple(values.shape)}.")
    if values.dtype == torch.uint64:
        raise InputError(f"the volume is {values.dtype}, which cannot be ordered: convert it to int64 or float64.")
    return comparable(values)


def _spacing(spacing: float | Spacing | None) -> Spacing:
    try:
        steps = np.broadcast_to(np.asarray(1.0 if spacing is None else spacing, dtype=float), 3)
    except (TypeError, ValueError) as error:
        raise InputError(f"spacing must be one number or three, got {spacing!r}.") from error
    if not (np.isfinite(steps).all() and (steps > 0).all()):
        raise InputError(f"spacing must be positive, got {spacing!r}.")
    return float(steps[0]), float(steps[1]), float(steps[2])


def _position(origin: Position) -> Position:
    try:
        x, y, z = (float(value) for value in origin)
    except (TypeError, ValueError) as error:
        raise InputError(f"origin must be three numbers, got {origin!r}.") from error
    if not np.isfinite((x, y, z)).all():
        raise InputError(f"origin must be finite, got {origin!r}.")
    return x, y, z


def _level(values: Tensor, level: float | None, label: int | None) -> tuple[float, tuple[str, ...]]:
    """The level to use, and what is to be said about it."""
    if label is not None:
        if level is not None:
            raise InputError(f"both level={level} and label={label} were given; one of them says what is inside.")
        return 0.0, (f"The solid is the voxels with label {label}.",)
    notes = []
    if values.is_floating_point():
        n_broken = sum(int(part.isnan().sum()) for part in torch.split(values.detach(), _SLAB))
        if n_broken:
            notes.append(f"{n_broken} voxels are NaN; they count as background.")
    if level is not None:
        return float(level), tuple(notes)
    if values.dtype == torch.bool:
        return 0.0, tuple(notes)
    low, high = _range(values)
    if low < 0 or any(
        bool(((part != 0) & (part != high) & ~part.isnan()).any()) for part in torch.split(values, _SLAB)
    ):
        raise InputError(
            f"the volume has more than the two values of a binary one, from {low:g} to {high:g}: pass level=… "
            f"(inside is above it; {(low + high) / 2:g} would be half-way) or, for a labelled volume, label=…"
        )
    return high / 2, tuple(notes)


def _range(values: Tensor) -> tuple[float, float]:
    parts = [part[~part.isnan()] for part in torch.split(values.detach(), _SLAB)]
    parts = [part for part in parts if part.numel()]
    if not parts:
        raise InputError("all voxels are NaN.")
    return float(min(part.min() for part in parts)), float(max(part.max() for part in parts))


def _answer(field: VoxelField) -> CountedAnswer:
    started = time.perf_counter()
    euler = int(field.exact_euler())
    seconds = time.perf_counter() - started
    inside = field.inside()
    components = grid_surfaces(inside, field.connectivity, field.spacing, field.origin)
    other_euler = int(field.exact_euler(32 - field.connectivity))
    return volume_answer(inside, components, field.connectivity, euler, other_euler, seconds)
