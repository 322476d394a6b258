"""Polynomial and trigonometric level sets of known topology, negative inside; and singular ones.

The truth is that of constructions (products of disjoint surfaces, doubles of plane domains with holes) or of Morse
theory: Σ g(x_i) has the critical points of g in every coordinate, so χ of {Σ g(x_i) ≤ c} is the alternating count of
those below c. The box is [−1, 1]³.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

Function = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Known:
    """A level set.

    Attributes:
        function: negative inside.
        eulers: characteristics of its components, ascending.
        cavities: of the solid inside.
        loops: in which it ends at the faces of the box.
    """

    function: Function
    eulers: tuple[int, ...]
    cavities: int = 0
    loops: int = 0


def sphere(radius: float, center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Function:
    """A polynomial of degree 2."""
    return lambda x: ((x - x.new_tensor(center)) ** 2).sum(1) - radius**2


def torus(major: float, minor: float, center: tuple[float, float, float] = (0.0, 0.0, 0.0), axis: int = 2) -> Function:
    """A polynomial of degree 4."""

    def function(x: Tensor) -> Tensor:
        squares = (x - x.new_tensor(center)) ** 2
        around = squares.sum(1) - squares[:, axis]
        return (squares.sum(1) + (major**2 - minor**2)) ** 2 - 4 * major**2 * around

    return function


def tube(major: float, minor: float, center: tuple[float, float, float] = (0.0, 0.0, 0.0), axis: int = 2) -> Function:
    """The same torus by the squared distance from its circle."""
    others = [other for other in range(3) if other != axis]

    def function(x: Tensor) -> Tensor:
        moved = x - x.new_tensor(center)
        return (moved[:, others].norm(dim=1) - major) ** 2 + moved[:, axis] ** 2 - minor**2

    return function


def product(*parts: Function) -> Function:
    """All of some disjoint surfaces: inside an odd number of them is inside."""

    def function(x: Tensor) -> Tensor:
        value = parts[0](x)
        for part in parts[1:]:
            value = -value * part(x)
        return value

    return function


def apart(*parts: Function) -> Function:
    """The product of functions that are positive outside: surfaces that do not contain each other."""

    def function(x: Tensor) -> Tensor:
        value = parts[0](x)
        for part in parts[1:]:
            value = value * part(x)
        return value

    return function


def plate(*holes: tuple[float, float, float]) -> Function:
    """The double of a disk with round holes (x, y, radius): genus is their number."""

    def function(x: Tensor) -> Tensor:
        u, v, w = x[:, 0], x[:, 1], x[:, 2]
        value = u**2 + v**2 - 0.81
        for a, b, radius in holes:
            value = value * ((u - a) ** 2 + (v - b) ** 2 - radius**2)
        return 3 * w**2 + value

    return function


def chmutov(degree: int, level: float) -> Function:
    """Chebyshev polynomials, T_n(1.2 x) + T_n(1.2 y) + T_n(1.2 z) − c, for n = 4 and 6."""

    def function(x: Tensor) -> Tensor:
        t = (1.2 * x) ** 2
        inner = 8 * t**2 - 8 * t + 1 if degree == 4 else 32 * t**3 - 48 * t**2 + 18 * t - 1
        return inner.sum(1) - level

    return function


def waves(count: float, level: float) -> Function:
    """Σ cos(kπ x_i) − c."""
    return lambda x: torch.cos(count * torch.pi * x).sum(1) - level


def confined(level: float) -> Function:
    """Σ (cos(5 x_i) + 4 x_i⁴) − c: two minima and one maximum in each coordinate."""
    return lambda x: (torch.cos(5 * x) + 4 * x**4).sum(1) - level


def lemniscate(width: float) -> Function:
    """A tube around an eight: genus 2."""

    def function(x: Tensor) -> Tensor:
        u, v, w = (1.8 * x).unbind(1)
        return (u**2 * (1 - u**2) - v**2) ** 2 + w**2 / 2 - width

    return function


HOLES = [(0.5, 0.0, 0.18), (-0.5, 0.0, 0.18), (0.0, 0.5, 0.18), (0.0, -0.5, 0.18), (0.0, 0.0, 0.18)]
LINKED = (torus(0.4, 0.1, (-0.2, 0.0, 0.0)), torus(0.4, 0.1, (0.2, 0.0, 0.0), axis=1))
CHAIN = (tube(0.3, 0.07, (-0.35, 0, 0)), tube(0.3, 0.07, axis=1), tube(0.3, 0.07, (0.35, 0, 0)))

KNOWN: dict[str, Known] = {
    "sphere": Known(sphere(0.7), (2,)),
    "small sphere, 0.001": Known(sphere(1e-3, (0.31, 0.17, -0.4)), (2,)),
    "smallest sphere, 0.0001": Known(sphere(1e-4, (0.31, 0.17, -0.4)), (2,)),
    "ellipsoid 1 : 5 : 20": Known(lambda x: (x**2 * x.new_tensor([1.0, 25.0, 400.0])).sum(1) - 0.64, (2,)),
    "x⁴ + y⁴ + z⁴": Known(lambda x: (x**4).sum(1) - 0.3, (2,)),
    "x⁸ + y⁸ + z⁸": Known(lambda x: (x**8).sum(1) - 0.1, (2,)),
    "two spheres 0.02 apart": Known(apart(sphere(0.3, (-0.31, 0, 0)), sphere(0.3, (0.31, 0, 0))), (2, 2)),
    "two spheres 0.002 apart": Known(apart(sphere(0.3, (-0.301, 0, 0)), sphere(0.3, (0.301, 0, 0))), (2, 2)),
    "spheres joined by a thin neck": Known(
        lambda x: apart(sphere(0.3, (-0.3, 0, 0)), sphere(0.3, (0.3, 0, 0)))(x) - 1e-4, (2,)
    ),
    "spheres nearly joined": Known(
        lambda x: apart(sphere(0.3, (-0.3, 0, 0)), sphere(0.3, (0.3, 0, 0)))(x) + 1e-4, (2, 2)
    ),
    "nested spheres": Known(product(sphere(0.8), sphere(0.6)), (2, 2), cavities=1),
    "three nested spheres": Known(product(sphere(0.85), sphere(0.6), sphere(0.35)), (2, 2, 2), cavities=1),
    "shell of 0.05": Known(product(sphere(0.65), sphere(0.6)), (2, 2), cavities=1),
    "torus": Known(torus(0.6, 0.2), (0,)),
    "thin torus, 0.02": Known(torus(0.6, 0.02), (0,)),
    "torus with a hole of 0.01": Known(torus(0.4, 0.395), (0,)),
    "nested tori": Known(product(tube(0.6, 0.3), tube(0.6, 0.15)), (0, 0), cavities=1),
    "sphere in a torus's hole": Known(apart(torus(0.65, 0.2), sphere(0.3)), (0, 2)),
    "sphere in a torus": Known(product(torus(0.6, 0.3), sphere(0.1, (0.6, 0, 0))), (0, 2), cavities=1),
    "linked tori": Known(apart(*LINKED), (0, 0)),
    "chain of three, by norms": Known(apart(*CHAIN), (0, 0, 0)),
    "genus 1 plate": Known(plate(HOLES[4]), (0,)),
    "genus 2 plate": Known(plate(*HOLES[:2]), (-2,)),
    "genus 3 plate": Known(plate(*HOLES[:2], HOLES[4]), (-4,)),
    "genus 4 plate": Known(plate(*HOLES[:4]), (-6,)),
    "genus 5 plate": Known(plate(*HOLES), (-8,)),
    "lemniscate": Known(lemniscate(0.01), (-2,)),
    "thin lemniscate": Known(lemniscate(0.002), (-2,)),
    "Chmutov 4, −2": Known(chmutov(4, -2.0), (2,) * 8),
    "Chmutov 4, 0": Known(chmutov(4, 0.0), (-8,)),
    "Chmutov 4, 2": Known(chmutov(4, 2.0), (2, 2), cavities=1),
    "Chmutov 4, −1.01": Known(chmutov(4, -1.01), (2,) * 8),
    "Chmutov 4, −0.99": Known(chmutov(4, -0.99), (-8,)),
    "Chmutov 4, 0.99": Known(chmutov(4, 0.99), (-8,)),
    "Chmutov 4, 1.01": Known(chmutov(4, 1.01), (2, 2), cavities=1),
    "Chmutov 6, −2": Known(chmutov(6, -2.0), (2,) * 27),
    "Chmutov 6, 0": Known(chmutov(6, 0.0), (-54,)),
    "cos 5x + 4x⁴, −0.3": Known(confined(-0.3), (2,) * 8),
    "cos 5x + 4x⁴, 0.8": Known(confined(0.8), (-8,)),
    "cell of Schwarz's P": Known(waves(1.0, 0.0), (-4,), loops=6),
    "P, nearly singular": Known(waves(1.0, -0.95), (-4,), loops=6),
    "gyroid, in a ball": Known(
        lambda x: (torch.sin(3 * x) * torch.cos(3 * x.roll(1, 1))).sum(1) + 2 * (x**2).sum(1) ** 3, (2,)
    ),
}

SINGULAR: dict[str, Function] = {
    "point": sphere(0.0),
    "cone": lambda x: x[:, 0] ** 2 + x[:, 1] ** 2 - x[:, 2] ** 2,
    "touching spheres": apart(sphere(0.25, (-0.25, 0, 0)), sphere(0.25, (0.25, 0, 0))),
    "touching inside": product(sphere(0.5), sphere(0.25, (0.25, 0, 0))),
    "double sphere": lambda x: sphere(0.5)(x) ** 2,
    "horn torus": torus(0.4, 0.4),
    "spindle torus": torus(0.3, 0.4),
    "Chmutov 4, −1": chmutov(4, -1.0),
    "Chmutov 4, 1": chmutov(4, 1.0),
    "three planes": lambda x: x[:, 0] * x[:, 1] * x[:, 2],
    "Whitney's umbrella": lambda x: x[:, 0] ** 2 - x[:, 1] ** 2 * x[:, 2],
    "Cayley's cubic": lambda x: (x**2).sum(1) + 2 * x[:, 0] * x[:, 1] * x[:, 2] - 1,
    "Steiner's surface": lambda x: (
        (x[:, 0] * x[:, 1]) ** 2 + (x[:, 1] * x[:, 2]) ** 2 + (x[:, 2] * x[:, 0]) ** 2 - x[:, 0] * x[:, 1] * x[:, 2]
    ),
    "lines of P": waves(1.0, -1.0),
    "spheres along a circle": lambda x: sphere(0.5)(x) * x[:, 2],
}
