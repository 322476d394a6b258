"""Loops compiled by numba, which is an optional package."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from topokit.errors import MissingDependencyError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def compiled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function as machine code, made when it is first called and kept on disk if possible.

    While it runs, other threads of Python go on.

    Raises:
        MissingDependencyError: if numba is not installed.
    """
    try:
        from numba import njit
    except ImportError as error:
        raise MissingDependencyError(
            'Counting a volume block by block needs numba: pip install "topokit[cluster]".'
        ) from error
    machine_code: Callable[Arguments, Result]
    try:
        machine_code = njit(cache=True, nogil=True)(function)
    except RuntimeError:  # there is no folder to keep it in, as in a container that is read-only
        machine_code = njit(nogil=True)(function)
    return machine_code
