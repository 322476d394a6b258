"""Reading volumes: the reader of each format, chosen by content; each gives an array (X, Y, Z) and its placement."""

from __future__ import annotations

import pkgutil
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from topokit.adapters.voxels.chosen_part import ALL, Entry, volume_axes, volume_index
from topokit.adapters.voxels.entry import FORMATS, VOXELS
from topokit.core.grid.placement import Placement
from topokit.errors import ReadError
from topokit.inputs.formats import format_of
from topokit.inputs.reading import reading

Volume = tuple[NDArray[Any], Placement | None]


def read_volume(path: Path, entry: Entry = ALL) -> Volume:
    """The array of a file or of a folder with a DICOM series, by content, and where its voxels are.

    Args:
        path: of it.
        entry: which part is the volume.

    The axes are in the order in which the format's reader gives them. The placement is None if the file has none.

    Raises:
        ReadError: if the file is malformed or holds no 3-D array.
        MissingDependencyError: if the format's reader is not installed.
    """
    found = format_of(FORMATS, path)
    if found is None or found.read is None:
        raise ReadError(f"{path} is not a volume by its content. Known: {', '.join(VOXELS.suffixes)}.")
    with reading(path, f"the {found.name} reader", extra="topokit[volumes]"):
        array, placement = pkgutil.resolve_name(found.read)(path)
    chosen = entry.chosen(array.shape, ())
    if array.ndim != 3 and len(volume_axes(array.shape, chosen)) != 3:
        one = "Of one slice give the folder with all slices, or pass topokit.from_voxels(array[None])."
        several = "Of several channels or times pass axis= and channel=, the number of an axis and of one along it."
        hint = one if array.ndim == 2 else several
        raise ReadError(f"{path} holds an array of shape {array.shape}; a volume (X, Y, Z) was expected. {hint}")
    return array[volume_index(array.shape, entry)] if chosen else array, placement
