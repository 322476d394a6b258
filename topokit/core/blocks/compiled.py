"""Loops compiled by numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from numba import njit

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def compiled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function as machine code, made when it is first called and kept on disk if possible.

    It is made again for other types of arguments; arrays that are not contiguous are another type, so copy them. While
    it runs, other threads of Python go on.
    """
    machine_code: Callable[Arguments, Result]
    try:
        machine_code = njit(cache=True, nogil=True)(function)
    except RuntimeError:  # there is no folder to keep it in, as in a container that is read-only
        machine_code = njit(nogil=True)(function)
    return machine_code
