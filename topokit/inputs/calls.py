"""Options of functions that users call by guess: an unknown one is an error that names the one that was meant."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import wraps
from inspect import signature
from typing import ParamSpec, TypeVar

from topokit.text import nearest

Options = ParamSpec("Options")
Result = TypeVar("Result")

_ELSEWHERE = {
    **dict.fromkeys(("threshold", "iso", "isovalue", "isolevel"), "level"),
    **dict.fromkeys(("voxel_size", "pitch"), "spacing"),
    **dict.fromkeys(("k", "knn", "neighbors"), "n_neighbors"),
    **dict.fromkeys(("samples", "n_points"), "n_samples"),
    **dict.fromkeys(("seed", "rng", "random_state"), "generator=torch.Generator().manual_seed(...)"),
    **dict.fromkeys(("box", "bbox", "extent"), "bounds"),
    **dict.fromkeys(("res", "grid", "n_cells"), "resolution"),
    **dict.fromkeys(("triangles", "cells"), "faces"),
    **dict.fromkeys(("vertices", "verts"), "source"),
    **dict.fromkeys(("pieces", "tunnels"), "betti=(pieces, tunnels, cavities)"),
}
"""What options that are usual elsewhere are called here, or how they are written."""


def no_option(owner: str, wrong: Iterable[str], known: Iterable[str], written: Callable[[str], str] = repr) -> str:
    """What an error says of options that do not exist: which exist, and what may have been meant.

    Args:
        owner: what has no such option.
        wrong: their names.
        known: names of those that exist.
        written: an option as its users write it.
    """
    known, wrong = sorted(known), sorted(wrong)
    meant = dict.fromkeys(one for name in wrong if (one := _meant(name, known)) is not None)
    hint = "".join(f" Did you mean {one}?" for one in meant)
    return f"{owner} has no option {', '.join(map(written, wrong))}.{hint} It has: {', '.join(known)}."


def _meant(name: str, known: list[str]) -> str | None:
    here = _ELSEWHERE.get(name)
    return here if here is not None and here.partition("=")[0] in known else nearest(name, known)


def options_by_name(likely: str) -> Callable[[Callable[Options, Result]], Callable[Options, Result]]:
    """A decorator of a function, whose TypeError about wrong options says what was meant.

    Args:
        likely: the option that one value too many was probably meant for.
    """

    def decorate(function: Callable[Options, Result]) -> Callable[Options, Result]:
        name = function.__qualname__.removesuffix(".__init__")
        known = {each: one for each, one in signature(function).parameters.items() if each != "self"}
        by_place = [each for each, one in known.items() if one.kind is not one.KEYWORD_ONLY]
        most = len(by_place) + ("self" in signature(function).parameters)

        @wraps(function)
        def call(*args: Options.args, **options: Options.kwargs) -> Result:
            if wrong := options.keys() - known.keys():
                raise TypeError(no_option(name, wrong, known))
            if len(args) > most:
                takes = f"{name}({', '.join(by_place)}) takes no value after {by_place[-1]} without its name"
                raise TypeError(f"{takes}: write {likely}=..., for example. It has: {', '.join(sorted(known))}.")
            return function(*args, **options)

        return call

    return decorate
