"""Functions of one variable with bounds of their values, slopes and second derivatives over intervals.

Each is monotone between the places listed with it, so that its extremes over an interval are at the ends or at one of
these places. A place that is listed twice is a jump. Outside of a function's domain everything is NaN: nothing is
proven.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.implicit.bounds.rounding import from_function

Ranges = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""The lowest and highest value over intervals, given by their ends."""

_FAR = 1e8  # beyond it the arguments of sine and cosine are too coarse


@dataclass(frozen=True, eq=False)
class Curve:
    """A function of one variable.

    Attributes:
        value: the function.
        values, slopes, bends: ranges of the function and of its first and second derivative.
        slope: the derivative.
    """

    value: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor], Tensor]
    values: Ranges
    slopes: Ranges
    bends: Ranges


def _between(function: Callable[[Tensor], Tensor], *extremes: tuple[float, float]) -> Ranges:
    """The ranges of a function that is monotone between places, given with the values there."""

    def ranges(low: Tensor, high: Tensor) -> tuple[Tensor, Tensor]:
        at_low, at_high = function(low), function(high)
        lowest, highest = torch.minimum(at_low, at_high), torch.maximum(at_low, at_high)
        for place, value in extremes:
            is_inside = (low <= place) & (place <= high)
            lowest = torch.where(is_inside & (lowest > value), value, lowest)
            highest = torch.where(is_inside & (highest < value), value, highest)
        return from_function(lowest, highest)

    return ranges


def _wave(function: Callable[[Tensor], Tensor], first_top: float) -> Ranges:
    """The ranges of a sine or cosine whose first maximum is here."""

    def ranges(low: Tensor, high: Tensor) -> tuple[Tensor, Tensor]:
        lowest, highest = from_function(*torch.aminmax(torch.stack((function(low), function(high))), dim=0))
        for top, is_top in ((first_top, True), (first_top + math.pi, False)):
            turns = [torch.floor((end - top) / (2 * math.pi)) for end in (low, high)]
            reached = (turns[1] > turns[0]) | ~((high - low) < 2 * math.pi) | ~(low > -_FAR) | ~(high < _FAR)
            highest, lowest = (
                (torch.where(reached, 1.0, highest), lowest)
                if is_top
                else (highest, torch.where(reached, -1.0, lowest))
            )
        return lowest.clamp(min=-1.0), highest.clamp(max=1.0)

    return ranges


def _on(domain: Callable[[Tensor], Tensor], function: Callable[[Tensor], Tensor]) -> Callable[[Tensor], Tensor]:
    return lambda x: torch.where(domain(x), function(x), math.nan)


def _curve(
    value: Callable[[Tensor], Tensor],
    slope: Callable[[Tensor], Tensor],
    bend: Callable[[Tensor], Tensor],
    *,
    of_value: tuple[tuple[float, float], ...] = (),
    of_slope: tuple[tuple[float, float], ...] = (),
    of_bend: tuple[tuple[float, float], ...] = (),
) -> Curve:
    return Curve(value, slope, _between(value, *of_value), _between(slope, *of_slope), _between(bend, *of_bend))


def _is_positive(x: Tensor) -> Tensor:
    return x > 0


def _mirrored(place: float, value: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Extremes of an odd function."""
    return (place, value), (-place, -value)


def _sigmoid_bend(x: Tensor) -> Tensor:
    s = x.sigmoid()
    return s * (-x).sigmoid() * (1 - 2 * s)


def _silu_slope(x: Tensor) -> Tensor:
    return x.sigmoid() * (1 + x * (-x).sigmoid())


def _silu_bend(x: Tensor) -> Tensor:
    s = x.sigmoid()
    return s * (-x).sigmoid() * (2 + x * (1 - 2 * s))


def _bell(x: Tensor) -> Tensor:
    return torch.exp(-x * x / 2) / math.sqrt(2 * math.pi)


def _gelu(x: Tensor) -> Tensor:
    return x * torch.special.ndtr(x)


def _root(x: Tensor) -> Tensor:
    return x.clamp(min=0).sqrt()  # where the function is defined its argument is not negative


def _softplus(x: Tensor) -> Tensor:
    return torch.logaddexp(x, torch.zeros_like(x))


def _softplus_bend(x: Tensor) -> Tensor:
    return x.sigmoid() * (-x).sigmoid()


def power(exponent: int) -> Curve:
    """The n-th power, n ≥ 2."""
    n, zero = exponent, ((0.0, 0.0),)
    return _curve(
        lambda x: x**n,
        lambda x: n * x ** (n - 1),
        lambda x: n * (n - 1) * x ** (n - 2),
        of_value=zero,
        of_slope=zero,
        of_bend=zero if n > 2 else (),
    )


SQUARE = power(2)
SQRT = _curve(_root, _on(_is_positive, lambda x: 0.5 * x.rsqrt()), _on(_is_positive, lambda x: -0.25 * x.rsqrt() ** 3))
EXP = _curve(torch.exp, torch.exp, torch.exp)
LOG = _curve(_on(_is_positive, torch.log), _on(_is_positive, torch.reciprocal), _on(_is_positive, lambda x: -1 / x**2))
TANH = _curve(
    torch.tanh,
    lambda x: 1 / x.cosh() ** 2,
    lambda x: -2 * x.tanh() / x.cosh() ** 2,
    of_slope=((0.0, 1.0),),
    of_bend=_mirrored(0.65847894846240835431, -0.76980035891950101935),
)
SIGMOID = _curve(
    torch.sigmoid,
    _softplus_bend,
    _sigmoid_bend,
    of_slope=((0.0, 0.25),),
    of_bend=_mirrored(1.31695789692481670862, -0.09622504486493762742),
)
SOFTPLUS = _curve(_softplus, torch.sigmoid, _softplus_bend, of_bend=((0.0, 0.25),))
ELU = _curve(
    lambda x: torch.where(x > 0, x, x.clamp(max=0).expm1()),
    lambda x: x.clamp(max=0).exp(),
    lambda x: torch.where(x > 0, 0.0, x.clamp(max=0).exp()),
    of_bend=((0.0, 0.0), (0.0, 1.0)),
)
SILU = _curve(
    torch.nn.functional.silu,
    _silu_slope,
    _silu_bend,
    of_value=((-1.2784645427610737951, -0.27846454276107379511),),
    of_slope=((-2.3993572805154676678, -0.09983932012886691696), (2.3993572805154676678, 1.099839320128866917)),
    of_bend=(
        (0.0, 0.5),
        (-3.435840993535110689, -0.036914373199893185638),
        (3.435840993535110689, -0.036914373199893185638),
    ),
)
GELU = _curve(
    _gelu,
    lambda x: torch.special.ndtr(x) + x * _bell(x),
    lambda x: _bell(x) * (2 - x * x),
    of_value=((-0.75179152469356445746, -0.16997120747990366169),),
    of_slope=((-1.4142135623730950488, -0.12890414518515478634), (1.4142135623730950488, 1.1289041451851547863)),
    of_bend=((0.0, 0.79788456080286535588), (-2.0, -0.1079819330263761039), (2.0, -0.1079819330263761039)),
)
ERF = _curve(
    torch.erf,
    lambda x: torch.exp(-x * x) * (2 / math.sqrt(math.pi)),
    lambda x: torch.exp(-x * x) * x * (-4 / math.sqrt(math.pi)),
    of_slope=((0.0, 2 / math.sqrt(math.pi)),),
    of_bend=_mirrored(0.7071067811865475244, -0.96788289807657339919),
)
ATAN = _curve(
    torch.atan,
    lambda x: 1 / (1 + x * x),
    lambda x: -2 * x / (1 + x * x) ** 2,
    of_slope=((0.0, 1.0),),
    of_bend=_mirrored(0.57735026918962576451, -0.64951905283832898507),
)
SIN = Curve(
    torch.sin, torch.cos, _wave(torch.sin, math.pi / 2), _wave(torch.cos, 0.0), _wave(lambda x: -x.sin(), -math.pi / 2)
)
COS = Curve(
    torch.cos,
    lambda x: -x.sin(),
    _wave(torch.cos, 0.0),
    _wave(lambda x: -x.sin(), -math.pi / 2),
    _wave(lambda x: -x.cos(), math.pi),
)


def _of_one_sign(function: Callable[[Tensor], Tensor]) -> Ranges:
    """The ranges of a function that is monotone on either side of 0 and has no value there."""
    plain = _between(function)

    def ranges(low: Tensor, high: Tensor) -> tuple[Tensor, Tensor]:
        is_defined = (low > 0) | (high < 0)
        lowest, highest = plain(low, high)
        return torch.where(is_defined, lowest, math.nan), torch.where(is_defined, highest, math.nan)

    return ranges


RECIPROCAL = Curve(
    torch.reciprocal,
    lambda x: -1 / x**2,
    _of_one_sign(torch.reciprocal),
    _of_one_sign(lambda x: -1 / x**2),
    _of_one_sign(lambda x: 2 / x**3),
)
