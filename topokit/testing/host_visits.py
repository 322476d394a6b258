"""Counts what would make an accelerator wait for the host or the host for it, on any machine."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

# Operations whose answer the host needs (a number, or the shape of the result), or that copy a constant from it, which
# torch does not do asynchronously.
_LOOKS = {
    "_linalg_check_errors": "an error is looked for",
    "_local_scalar_dense": "a number is read",
    "_unique2": "the shape depends on values",
    "bincount": "the shape depends on values",
    "equal": "a number is read",
    "lift_fresh": "a constant is copied to the device",
    "linalg_eigh": "an error is looked for",
    "_linalg_eigh": "an error is looked for",
    "masked_select": "the shape depends on values",
    "nonzero": "the shape depends on values",
    "repeat_interleave": "the shape depends on values",
    "unique_consecutive": "the shape depends on values",
    "unique_dim": "the shape depends on values",
}
_METHODS = {
    Tensor.__array__: "a copy is made on the host",
    Tensor.cpu: "a copy is made on the host",
    Tensor.numpy: "a copy is made on the host",
    Tensor.tolist: "a copy is made on the host",
}


@dataclass(frozen=True)
class HostVisit:
    """One copy between device and host, or one synchronization.

    Attributes:
        operation: of torch, such as "nonzero".
        reason: why the host and the device wait for each other.
        place: file and line of the code that called it.
    """

    operation: str
    reason: str
    place: str


@dataclass
class HostVisits:
    """The visits in the order in which they happened; `len` counts them."""

    visits: list[HostVisit] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.visits)

    def __iter__(self) -> Iterator[HostVisit]:
        return iter(self.visits)

    def __str__(self) -> str:
        return "\n".join(f"{one.place}: {one.operation} ({one.reason})" for one in self.visits) or "no visits"

    def add(self, operation: str, reason: str) -> None:
        """Record a visit with the place that caused it."""
        self.visits.append(HostVisit(operation, reason, _caller()))


@contextmanager
def count_host_visits() -> Iterator[HostVisits]:
    """Context that counts device-to-host copies and synchronizations, whatever the device is.

    Counted are numbers that are read (`item`, `bool`, `float`), arrays that leave torch (`numpy`, `tolist`, `cpu`),
    copies to another device, results whose shape depends on values (`nonzero`, `unique`, indexing by a mask), checks
    for errors of linear algebra, and constants that are copied to the device. On the CPU none of these costs anything;
    on an accelerator each stops the queue. Use it with `as_on_accelerator` to see what happens there.

    Yields:
        `HostVisits`, which is filled while the context is open.

    Example:
        >>> import torch
        >>> from topokit.testing import count_host_visits
        >>> with count_host_visits() as visits:
        ...     if torch.ones(3).sum() > 2: pass
        >>> [visit.operation for visit in visits]
        ['_local_scalar_dense']
    """
    visits = HostVisits()
    with _Methods(visits), _Operations(visits):
        yield visits


class _Operations(TorchDispatchMode):
    """Sees every operation of torch, in forward and backward passes."""

    def __init__(self, visits: HostVisits) -> None:
        super().__init__()
        self._visits = visits

    def __torch_dispatch__(
        self, func: Any, types: Sequence[type], args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        result = func(*args, **(kwargs or {}))
        name = func.overloadpacket.__name__
        if name in _LOOKS and not (name == "repeat_interleave" and (kwargs or {}).get("output_size") is not None):
            self._visits.add(name, _LOOKS[name])
        elif name in ("index", "index_put", "index_put_") and _has_mask(args[1]) and not _is_fill(name, args):
            self._visits.add(name, "the shape depends on values")
        elif name in ("_to_copy", "copy_") and _leaves_device(name, args, result):
            self._visits.add(name, "a copy goes to another device")
        return result


class _Methods(TorchFunctionMode):
    """Sees the methods of tensors that leave torch without an operation."""

    def __init__(self, visits: HostVisits) -> None:
        super().__init__()
        self._visits = visits

    def __torch_function__(
        self, func: Callable[..., Any], types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        if func in _METHODS:
            self._visits.add(func.__name__, _METHODS[func])
        return func(*args, **(kwargs or {}))


def _has_mask(index: Sequence[Tensor | None]) -> bool:
    return any(one is not None and one.dtype in (torch.bool, torch.uint8) for one in index)


def _is_fill(name: str, args: tuple[Any, ...]) -> bool:
    """Whether one number is written where a mask is true: that is done in place, without synchronization."""
    return name != "index" and args[2].numel() == 1 and not args[2].requires_grad


def _leaves_device(name: str, args: tuple[Any, ...], result: Tensor) -> bool:
    source = args[1] if name == "copy_" else args[0]
    return source.device != result.device


def _caller() -> str:
    """File and line of the innermost frame outside of torch and of this module."""
    frame = sys._getframe(1)
    while frame.f_back is not None:
        module = frame.f_globals.get("__name__", "")
        if module != __name__ and module.split(".")[0] not in ("torch", "contextlib"):
            break
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"
