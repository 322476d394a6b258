"""Whether to avoid synchronization with the host: always on accelerators, on the CPU in tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import torch
from torch import Tensor

_asked_for: ContextVar[bool] = ContextVar("as_on_accelerator", default=False)


def stays_on_device(where: Tensor | torch.device) -> bool:
    """Whether to work in torch operations alone on a tensor or device, without looking at values on the host."""
    device = where.device if isinstance(where, Tensor) else where
    return device.type != "cpu" or torch.compiler.is_compiling() or _asked_for.get()


@contextmanager
def as_on_accelerator() -> Iterator[None]:
    """Context in which tensors on the CPU are treated as those on accelerators are.

    Neighbors are searched in torch operations instead of SciPy's KD-tree, and samples are not checked for NaN, which
    would synchronize with the device: NaN in gives NaN out. For tests, on machines without an accelerator. Take the
    backward pass inside, too: it repeats parts of the forward pass.

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import as_on_accelerator, sphere_samples
        >>> with as_on_accelerator():
        ...     round(float(tk.from_points(sphere_samples(1000).points).gauss_bonnet()))
        2
    """
    token = _asked_for.set(True)
    try:
        yield
    finally:
        _asked_for.reset(token)
