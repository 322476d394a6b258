"""Checks of the losses' arguments, each with one message."""

from __future__ import annotations

import math
from numbers import Integral, Real

from topokit.core.grid.tau import SMALLEST_TAU
from topokit.errors import InputError


def check_count(name: str, value: object, least: int) -> None:
    """Raise InputError unless the value is an integer of at least `least`."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(f"{name} must be an integer of at least {least}, not {value!r}.")


def check_choice(name: str, value: object, choices: tuple[object, ...]) -> None:
    """Raise InputError unless the value is one of the choices."""
    if value not in choices:
        raise InputError(f"{name} must be one of {choices}, not {value!r}.")


def check_finite(name: str, value: object) -> None:
    """Raise InputError unless the value is a finite number."""
    if not isinstance(value, Real) or isinstance(value, bool) or not math.isfinite(value):
        raise InputError(f"{name} must be a finite number, not {value!r}.")


def check_tau(tau: object) -> None:
    """Raise InputError unless τ is None or a positive finite number."""
    is_number = isinstance(tau, (int, float)) and not isinstance(tau, bool)
    if tau is not None and not (is_number and SMALLEST_TAU <= tau < math.inf):  # type: ignore[operator]
        raise InputError(f"tau must be a positive number, not {tau!r}.")
