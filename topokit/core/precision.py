"""Geometry in the precision of its tensors, also where `torch.autocast` is on around it."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import torch

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

_DEVICES = ("cpu", "cuda", "mps", "xpu")


def full_precision(work: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorator: the function runs as if `torch.autocast` were off.

    Autocast rounds the factors of matrix products to half precision: three digits are too few for differences between
    neighboring points, and too few to decide on which side of its level a field is.
    """

    @wraps(work)
    def precise(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        for device in _DEVICES:
            if torch.is_autocast_enabled(device):
                with torch.autocast(device, enabled=False):
                    return precise(*args, **kwargs)
        return work(*args, **kwargs)

    return precise
