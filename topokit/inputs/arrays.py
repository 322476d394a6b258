"""Arrays of any library as tensors: tensors as they are, others through DLPack, else through NumPy."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.dlpack import from_dlpack

from topokit.errors import InputError

_DLPACK = ("__dlpack__", "to_dlpack")  # the protocol; its predecessor, as in tensors of open3d before 0.20


def is_array(values: object) -> bool:
    """Whether this is a tensor, or has `__dlpack__` (or its predecessor `to_dlpack`) or `__array__`."""
    return isinstance(values, Tensor) or any(hasattr(values, method) for method in (*_DLPACK, "__array__"))


def as_tensor(values: object, name: str, expected: str) -> Tensor:
    """Real numbers as a tensor of their own type.

    Args:
        values: a tensor, which is returned with its graph; anything with `__dlpack__`, which shares its memory and
            stays on its device; anything with `__array__`, or nested sequences, which share memory where NumPy can.
            Do not write to the result.
        name: what to call the values in errors.
        expected: the shape to name in errors.

    Raises:
        InputError: if the values are not real numbers, or neither DLPack nor NumPy can convert them.
    """
    shared = _shared(values, name)
    tensor = _through_numpy(values, name, expected) if shared is None else shared
    if tensor.is_complex():
        raise InputError(f"{name} must hold real numbers, got {tensor.dtype}; expected shape {expected}.")
    return tensor


def as_floating(values: object, name: str, expected: str) -> Tensor:
    """Real numbers in a floating-point type that the core supports.

    Tensors and arrays through DLPack keep their floating type, half precision is widened to float32. Integers through
    DLPack, and all arrays through NumPy, become float64 copies. Integer tensors stay as they are; `SurfaceSamples`
    rejects them.

    Args:
        values: see `as_tensor`.
        name: what to call the values in errors.
        expected: the shape to name in errors.

    Raises:
        InputError: see `as_tensor`.
    """
    shared = _shared(values, name)
    if shared is None or not (isinstance(values, Tensor) or shared.is_floating_point()):
        return as_tensor(values, name, expected).to(torch.float64, copy=True)
    return shared.float() if shared.dtype in (torch.float16, torch.bfloat16) else shared


def as_positions(values: object, name: str) -> Tensor:
    """Finite points (N, 3) in a floating-point type that the core supports; arguments as for `as_tensor`.

    Raises:
        InputError: if they are something else.
    """
    points = as_floating(values, name, "(N, 3)")
    if points.ndim != 2 or points.shape[1] != 3 or not bool(points.isfinite().all()):
        raise InputError(f"{name} must be finite points (N, 3), got a tensor of shape {tuple(points.shape)}.")
    return points


def _shared(values: Any, name: str) -> Tensor | None:
    """The tensor itself, or a tensor on the same memory through DLPack; None if only NumPy can convert the values."""
    if isinstance(values, Tensor):
        return values
    export = next((getattr(values, method) for method in _DLPACK if hasattr(values, method)), None)
    if export is None or isinstance(values, np.ndarray):
        return None
    try:
        return from_dlpack(values if hasattr(values, "__dlpack_device__") else export())
    except (AttributeError, BufferError, RuntimeError, TypeError, ValueError) as error:
        if hasattr(values, "__array__"):
            return None
        raise InputError(
            f"{name}: {type(values).__name__} could not be converted through DLPack ({error}); convert it to a tensor "
            "or a NumPy array first."
        ) from error


def _through_numpy(values: object, name: str, expected: str) -> Tensor:
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biufcO":
            raise TypeError(f"they are {array.dtype}")
        if array.dtype.kind == "O" or array.dtype == np.longdouble:
            array = array.astype(np.float64)
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        if any(stride < 0 for stride in array.strides):
            array = array.copy()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The given NumPy array is not writable", UserWarning)
            return torch.from_numpy(array)
    except (RuntimeError, TypeError, ValueError) as error:
        raise InputError(f"{name} could not be read as numbers ({error}); expected shape {expected}.") from error
