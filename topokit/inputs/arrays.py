"""Arrays of any library as tensors: torch's own as they are, others through DLPack, all else through NumPy."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.dlpack import from_dlpack

from topokit.errors import InputError

_DLPACK = ("__dlpack__", "to_dlpack")  # the protocol, and what tensors of open3d before 0.20 have


def is_array(values: object) -> bool:
    """Whether it is a tensor, or offers `__dlpack__` (or its forerunner `to_dlpack`) or `__array__`."""
    return isinstance(values, Tensor) or any(hasattr(values, way) for way in (*_DLPACK, "__array__"))


def as_tensor(values: object, name: str, expected: str) -> Tensor:
    """Real numbers as a tensor of their own type.

    Args:
        values: a tensor, which is returned as it is, with its graph; anything with `__dlpack__`, whose memory is shared
            and which stays on its device; anything with `__array__`, or nested sequences. Their memory is shared, too,
            where NumPy can do so: nobody is to write to the result.
        name: what to call the values in errors.
        expected: the shape to name in errors.

    Raises:
        InputError: if these are no real numbers, or DLPack and NumPy both refuse.
    """
    shared = _shared(values, name)
    tensor = _by_numpy(values, name, expected) if shared is None else shared
    if tensor.is_complex():
        raise InputError(f"{name} must hold real numbers, got {tensor.dtype}; expected shape {expected}.")
    return tensor


def as_floating(values: object, name: str, expected: str) -> Tensor:
    """Real numbers as floating point, in which the core can compute.

    Tensors keep their type (integers are refused further on: nobody can differentiate them), and so does what comes by
    DLPack; its integers, and everything that comes by way of NumPy, become float64, copied. Half precision is
    widened to float32.

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


def _shared(values: Any, name: str) -> Tensor | None:
    """The tensor itself, or one that DLPack makes of the same memory; None where NumPy is to be asked."""
    if isinstance(values, Tensor):
        return values
    hand_over = next((getattr(values, way) for way in _DLPACK if hasattr(values, way)), None)
    if hand_over is None or isinstance(values, np.ndarray):
        return None
    try:
        return from_dlpack(values if hasattr(values, "__dlpack_device__") else hand_over())
    except (AttributeError, BufferError, RuntimeError, TypeError, ValueError) as error:
        if hasattr(values, "__array__"):
            return None
        raise InputError(
            f"{name}: {type(values).__name__} could not be handed over by DLPack ({error}); convert it to a tensor "
            "or a NumPy array first."
        ) from error


def _by_numpy(values: object, name: str, expected: str) -> Tensor:
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
