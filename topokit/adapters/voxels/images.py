"""Images of other libraries, by their attributes: nibabel, SimpleITK and MONAI; none of them is imported."""

from __future__ import annotations

from typing import Any

import numpy as np
from torch import Tensor

from topokit.adapters.voxels.medical import column_lengths, itk_array
from topokit.core.grid.grid import Spacing
from topokit.errors import InputError


def image_of(source: Any) -> tuple[Any, Spacing | None] | None:
    """The voxels and their sizes of an object that holds an image.

    Args:
        source: an image of nibabel, a `SimpleITK.Image`, or a `MetaTensor` of MONAI, with or without its channel.

    Returns:
        Voxels (X, Y, Z) as an array or tensor, and their sizes or None; None for other objects.

    Raises:
        InputError: if it has several channels.
    """
    affine = getattr(source, "affine", None)
    if hasattr(source, "dataobj") and affine is not None:
        values = np.asanyarray(source.dataobj)
        return values[..., 0] if values.ndim == 4 and values.shape[3] == 1 else values, column_lengths(affine)
    if isinstance(source, Tensor) and isinstance(affine, Tensor):
        plain = source.as_tensor() if hasattr(source, "as_tensor") else source
        return _only_channel(plain), column_lengths(affine.detach().cpu())
    if hasattr(source, "GetSpacing") and hasattr(source, "GetNumberOfComponentsPerPixel"):
        return itk_array(source)
    return None


def _only_channel(values: Tensor) -> Tensor:
    """(X, Y, Z) of (1, X, Y, Z)."""
    if values.ndim != 4:
        return values
    if len(values) != 1:
        raise InputError(f"the image has {len(values)} channels; pass one of them: topokit.from_voxels(image[0]).")
    return values[0]
