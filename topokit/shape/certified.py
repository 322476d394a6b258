"""Reports of level sets whose topology is proven by bounds, or was tried to be."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from topokit.errors import InputError
from topokit.report.certificate import Certificate
from topokit.report.counted import CountedAnswer, counted_report
from topokit.report.report import TopologyReport

if TYPE_CHECKING:
    from topokit.shape.shape import Shape


class Bounded(Protocol):
    """A level set of a function that has bounds, or may have them."""

    def certificate(self, seconds: float) -> Certificate:
        """What bounds prove in so many seconds; an InputError if there are none."""

    def witnessed(self) -> CountedAnswer:
        """The answer of grids, and what bounds prove of it at about the same cost."""


def certify(shape: Shape, time_limit: float = 60.0) -> Certificate:
    """A proof of the topology of a function's level set in its box, by bounds of the function and its gradient.

    An octree is divided until every cell is free of the surface or holds a piece of it that is a graph, and the
    surface is replaced by triangles of which a theorem says that an isotopy of the box turns them into it. All
    bounds hold rounding errors. The function is taken in exact arithmetic with its weights as they are stored:
    what another precision makes of it is not proven. It must be made of operations of torch that have bounds.

    Args:
        shape: made from a function.
        time_limit: seconds after which no cell is divided any more.

    Returns:
        A `Certificate`, with what is proven, or the places where nothing is.

    Raises:
        InputError: if the shape was not made from a function, an operation in it has no bounds (it is named), or
            the time is not positive.

    Reference:
        After Plantinga and Vegter, "Isotopic approximation of implicit curves and surfaces", SGP 2004; the theorem
        with its proof is in `topokit.core.implicit.certificate.proof`.

    Example:
        >>> import topokit as tk
        >>> found = tk.from_sdf(lambda x: x.norm(dim=1) - 0.7, bounds=(-1, 1)).certify()
        >>> found.verdict, found.euler, len(found.components)
        ('certain', 2, 1)
    """
    if shape._bounded is None:
        raise InputError(
            f"{shape.name} was not made from a function: only level sets of functions are proven by bounds. Meshes "
            "and volumes are counted, which is a proof."
        )
    if not time_limit > 0:
        raise InputError(f"time_limit must be positive, not {time_limit}.")
    return shape._bounded.certificate(time_limit)


def certified_report(shape: Shape, bounded: Bounded, *, without_grids: bool) -> TopologyReport:
    """The report of what is proven, or that of the grids.

    Args:
        shape: made from a function.
        bounded: its level set.
        without_grids: whether grids are asked only if nothing is proven; the report then says which places stay open.
    """
    if not without_grids:
        return counted_report(shape.name, shape.notes, bounded.witnessed())
    proven = shape.certify()
    if proven.answer is not None:
        return counted_report(shape.name, shape.notes, proven.answer)
    report = shape.report(certify=False)
    return replace(report, reasons=(*report.reasons, proven.statement))
