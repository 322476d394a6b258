"""Two sources compared: `topokit.compare(prediction, truth)`, also label by label."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from topokit.adapters.voxels.masks import OpenedVolume, mask_of, opened_volume
from topokit.batch.names import distinguishing_names
from topokit.batch.sources import Source
from topokit.comparison.result import Comparison, Matching
from topokit.comparison.solids import compare_solids
from topokit.core.arrays import Booleans
from topokit.core.grid.grid import Spacing
from topokit.core.grid.labels import joined_boxes, tight_boxes
from topokit.errors import InputError, Option
from topokit.inputs.arrays import is_array
from topokit.plugins.registry import adapter_for, load
from topokit.shape import Shape
from topokit.shape.compare import DEFAULT_CELLS

_WHOLE = (slice(None),) * 3
Ignore = float | Tensor | Booleans | str | os.PathLike[str] | None


def compare(
    a: Any,
    b: Any,
    *,
    ignore: Ignore = None,
    level: float | None = None,
    label: float | tuple[float, ...] | None = None,
    connectivity: int | None = None,
    matching: Matching = "invariant",
    spacing: float | Spacing | None = None,
    tolerance: float | None = None,
    resolution: int = DEFAULT_CELLS,
) -> Comparison:
    """Which parts, tunnels and cavities of a solid match those of a true one, which are missing, and which spurious.

    What matches is counted without a choice of loops: the dimension of im H_k(a) ∩ im H_k(b) in H_k(a ∪ b), over GF(2).
    So mirroring or turning both changes nothing. `docs/comparing.md` has the definition with a proof.

    Args:
        a: what is judged: an array, tensor or file of a volume, or a `Shape` or whatever `load` opens. A volume may be
            empty.
        b: the truth. Two volumes need one grid; all other pairs are compared as solids on a common grid, in the frame
            in which they are given.
        ignore: voxels that count as background in both: a mask (X, Y, Z), a file of one, or the value that they have in
            b. For volumes only.
        level: of volumes, as for `from_voxels`; of both.
        label: likewise.
        connectivity: 6 or 26, of both solids; the background has the other one. That of the shapes, or 26, if None.
        matching: "invariant", or "betti-matching" for the count of Betti-Matching-3D, which is 6-connected and depends
            on the orientation of the grid; see `docs/comparing.md`.
        spacing: size of a voxel, as for `from_voxels`.
        tolerance: distance of surfaces that counts as none in `Comparison.agreement`; a step of the grid if None.
        resolution: cells of the common grid along the longest side, for everything but volumes.

    Raises:
        InputError: if the grids of two volumes differ, a shape has no closed surface, or an option does not apply.
        TopokitError: whatever `load` raises.

    Example:
        >>> import numpy as np, topokit as tk
        >>> truth = np.zeros((7, 7, 7), dtype=bool)
        >>> truth[1:6, 1:6, 2:5] = True
        >>> prediction = truth.copy()
        >>> prediction[3, 3] = False
        >>> found = tk.compare(prediction, truth)
        >>> found.betti_error, found.features[0].kind
        ((0, 1, 0), 'hole')
    """
    if _is_volume(a) and _is_volume(b):
        first, second, ignored = _opened(a, b, spacing, ignore)
        mine, true = (_mask(one, level, label) & ~ignored for one in (first, second))
        return compare_solids(
            mine,
            true,
            second.grid,
            placement=second.placement,
            connectivity=connectivity,
            matching=matching,
            tolerance=tolerance,
            names=(first.name, second.name),
        )
    given = {"ignore": ignore, "level": level, "label": label, "spacing": spacing}
    if wrong := [Option(name, "…") for name, value in given.items() if value is not None]:
        raise InputError("only two volumes, as arrays or files, are compared with ", wrong[0], ": leave it out.")
    one, other = (each if isinstance(each, Shape) else load(each) for each in (a, b))
    return one.compare(other, resolution=resolution, tolerance=tolerance, connectivity=connectivity, matching=matching)


def compare_labels(
    a: Any,
    b: Any,
    labels: Literal["all"] | Sequence[int] = "all",
    *,
    ignore: Ignore = None,
    connectivity: int | None = None,
    matching: Matching = "invariant",
    spacing: float | Spacing | None = None,
    tolerance: float | None = None,
) -> dict[int, Comparison]:
    """Compare two labeled volumes label by label, each in the box of its own voxels.

    Args:
        a: (X, Y, Z) whole numbers, as an array, a tensor or a file: what is judged.
        b: the truth, on the same grid.
        labels: the labels that are wanted, or "all" positive ones of either volume.
        ignore: as for `compare`.
        connectivity: 6 or 26, of each label by itself; 26 if None.
        matching: as for `compare`; by Betti matching each label is compared in the whole grid.
        spacing: likewise.
        tolerance: likewise.

    Returns:
        Comparisons by label, in the given order or ascending. A label that only one volume has is missing or spurious
        as a whole.

    Raises:
        InputError: if the grids differ, or values are no whole numbers.

    Example:
        >>> import numpy as np, topokit as tk
        >>> truth = np.zeros((4, 4, 9), dtype=int)
        >>> truth[1:3, 1:3, 1:4], truth[1:3, 1:3, 5:8] = 1, 2
        >>> {label: found.missing for label, found in tk.compare_labels(truth * (truth == 1), truth).items()}
        {1: (0, 0, 0), 2: (1, 0, 0)}
    """
    first, second, ignored = _opened(a, b, spacing, ignore)
    values = [np.where(ignored, 0, one.values.numpy()) for one in (first, second)]
    boxes = [tight_boxes(each) for each in values]
    wanted = sorted(label for label in boxes[0].keys() | boxes[1].keys() if label > 0) if labels == "all" else labels
    found, both, step = {}, joined_boxes(*boxes), second.grid.spacing
    for label in wanted:
        box = both.get(label, (slice(0, 0),) * 3) if matching == "invariant" else _WHOLE
        x, y, z = (start + (side.start or 0) * n for start, side, n in zip(second.grid.origin, box, step, strict=True))
        mine, true = (each[box] == label for each in values)
        names = f"{first.name}, label {label}", f"{second.name}, label {label}"
        found[int(label)] = compare_solids(
            mine,
            true,
            replace(second.grid, shape=mine.shape, origin=(x, y, z)),
            placement=second.placement,
            connectivity=connectivity,
            matching=matching,
            tolerance=tolerance,
            names=names,
        )
    return found


def _is_volume(source: Any) -> bool:
    if isinstance(source, str | os.PathLike):
        return adapter_for(source).name == "voxels"
    return is_array(source) and not isinstance(source, Shape)


def _mask(opened: OpenedVolume, level: float | None, label: float | tuple[float, ...] | None) -> Booleans:
    """As `mask_of`, with errors that say which volume it is."""
    try:
        return mask_of(opened.values, level, label)
    except InputError as error:
        raise InputError(f"{opened.name}: ", *error.parts) from error


def _opened(
    a: Any, b: Any, spacing: float | Spacing | None, ignore: Ignore
) -> tuple[OpenedVolume, OpenedVolume, Booleans]:
    """Both volumes and which of their voxels are ignored; these are 0 in both."""
    first, second = (opened_volume(one, spacing) for one in (a, b))
    if first.name == second.name and isinstance(a, str | os.PathLike) and isinstance(b, str | os.PathLike):
        names = distinguishing_names([Source(Path(one), os.fspath(one)) for one in (a, b)])
        first, second = first._replace(name=names[os.fspath(a)]), second._replace(name=names[os.fspath(b)])
    if first.grid.shape != second.grid.shape:
        raise InputError(
            f"{first.name} has {first.grid.shape} voxels and {second.name} {second.grid.shape}: resample one of them "
            "to the grid of the other."
        )
    if not np.allclose(first.grid.spacing, second.grid.spacing, rtol=1e-3):
        raise InputError(
            f"the voxels of {first.name} are {first.grid.spacing} and those of {second.name} {second.grid.spacing}: "
            "resample one of them, or pass ",
            Option("spacing", "…"),
            " if a header is wrong.",
        )
    if ignore is None:
        return first, second, np.zeros(first.grid.shape, bool)
    if isinstance(ignore, int | float):
        ignored = (second.values == ignore).numpy()
    else:
        ignored = mask_of(opened_volume(ignore, spacing).values, None, None)
        if ignored.shape != first.grid.shape:
            raise InputError(f"ignore has shape {ignored.shape}, but the volumes have {first.grid.shape}.")
    hidden = torch.from_numpy(ignored)
    kept = [one._replace(values=one.values.masked_fill(hidden, 0)) for one in (first, second)]
    return kept[0], kept[1], ignored
