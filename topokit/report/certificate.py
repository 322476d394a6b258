"""What a proof by bounds says about a level set: a statement, an answer for the report, and places that stay open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from topokit.core.components import Corner, CountedComponents
from topokit.core.surface import TriangleSurface
from topokit.report.counted import CountedAnswer
from topokit.report.report import Evidence
from topokit.report.verdict import Verdict, proof_verdict
from topokit.report.wording import plural, position

if TYPE_CHECKING:
    from topokit.core.implicit.certificate.proof import Place, Proof

_SHOWN = 3  # places in the statement


@dataclass(frozen=True, eq=False)
class Certificate:
    """What is proven about the level set of a function in a box.

    The proof is about the function in exact arithmetic, with its weights as they are stored; see `Shape.certify`.

    Attributes:
        name: what was examined.
        low, high: corners of the box.
        verdict: "certain" if the whole surface is proven and does not reach the box, else "unsure".
        statement: what is proven, or where nothing is.
        components: of the surface, largest area first; None unless all of it is proven.
        surface: triangles that an isotopy of the box turns into the level set; likewise. Their vertices are near it
            only as far as cells are small.
        reached: names of the faces of the box that the surface reaches, as "x = 1".
        places: boxes (lowest and highest corner) around the cells in which nothing is proven, largest first.
        n_open: the number of those cells.
        n_cells: cells whose bounds were computed.
        smallest: side of the smallest of them.
        seconds: time it took.
    """

    name: str
    low: Corner
    high: Corner
    verdict: Verdict
    statement: str
    components: CountedComponents | None
    surface: TriangleSurface | None
    reached: tuple[str, ...]
    places: tuple[Place, ...]
    n_open: int
    n_cells: int
    smallest: float
    seconds: float

    @property
    def euler(self) -> int | None:
        """Euler characteristic of the surface, or None unless all of it is proven."""
        return None if self.components is None else int(self.components.euler.sum())

    @property
    def genus(self) -> int | None:
        """Handles of the surface, likewise."""
        return None if self.components is None else self.components.genus

    @property
    def answer(self) -> CountedAnswer | None:
        """The counted answer that is proven, or None."""
        if self.verdict != "certain" or self.components is None or self.euler is None:
            return None
        return CountedAnswer(
            evidence=Evidence("proof by bounds of the gradient", float(self.euler), self.euler, self.seconds),
            components=self.components,
            closed=True,
            boundary_loops=0,
            verdict=self.verdict,
            reasons=(self.statement,),
            manifold=True,
        )

    def __str__(self) -> str:
        return f"{self.name}: {self.statement[:-2]}, {self.seconds:.3g} s)."


def certificate(name: str, proof: Proof, low: Corner, high: Corner) -> Certificate:
    """The certificate of a proof.

    Args:
        name: what was examined.
        proof: about it.
        low: lowest corner of the box.
        high: highest corner.
    """
    reached = tuple(
        f"{letter} = {end:g}"
        for letter, pair, ends in zip("xyz", proof.reached, zip(low, high, strict=True), strict=True)
        for is_reached, end in zip(pair, ends, strict=True)
        if is_reached
    )
    return Certificate(
        name=name,
        low=low,
        high=high,
        verdict=proof_verdict(is_complete=proof.components is not None, reaches_box=bool(reached)),
        statement=_statement(proof, low, high, reached),
        components=proof.components,
        surface=proof.surface,
        reached=reached,
        places=proof.places,
        n_open=proof.n_open,
        n_cells=proof.n_cells,
        smallest=proof.smallest,
        seconds=proof.seconds,
    )


def with_proof(counted: CountedAnswer, found: Certificate, n_hidden: int, step: float) -> CountedAnswer:
    """The answer of grids and what bounds say of it.

    Args:
        counted: by grids.
        found: by bounds.
        n_hidden: places that bounds leave where the function has a sign that grids do not see around them.
        step: between the points of the finest grid.
    """
    proven = found.answer
    deciding, others = counted.reasons[: counted.n_deciding], counted.reasons[counted.n_deciding :]
    if proven is None:
        is_hidden = n_hidden > 0
        doubts = (_hidden(n_hidden, step),) if is_hidden else ()
        tried = found.statement if found.components is not None else _untried(found.n_open)
        return replace(
            counted,
            verdict="unsure" if is_hidden else counted.verdict,
            reasons=(*doubts, *deciding, *others, tried),
            n_deciding=len(doubts) + len(deciding),
        )
    further = (counted.evidence, *counted.further)
    if (found.euler, proven.components.solid_betti) == (counted.evidence.integer, counted.components.solid_betti):
        reasons = (found.statement, *counted.reasons)
        return replace(proven, components=counted.components, reasons=reasons, further=further)
    contradicted = f"Grids of up to {step:.3g} between points see another surface, of χ {counted.evidence.integer}."
    return replace(proven, reasons=(found.statement, contradicted, *others), further=further)


def _hidden(n_hidden: int, step: float) -> str:
    return (
        f"At {plural(n_hidden, 'place')} that bounds leave, the function has a sign that no point of the last grid "
        f"within two cells has: parts thinner than {step:.3g} are missed."
    )


def _untried(n_open: int) -> str:
    return f"Bounds prove nothing for as many evaluations: {plural(n_open, 'cell stays', 'cells stay')} open."


def _statement(proof: Proof, low: Corner, high: Corner, reached: tuple[str, ...]) -> str:
    size = f"{plural(proof.n_cells, 'cell')}, sides down to {proof.smallest:.2g}"
    found = proof.components
    if found is None:
        return f"Not proven: {_open_places(proof)} ({size})."
    box = f"({', '.join(f'{x:g}' for x in low)}) … ({', '.join(f'{x:g}' for x in high)})"
    if not len(found):
        return f"Proven: there is no level set in the box {box} ({size})."
    loops = int(found.boundary_loops.sum())
    kind = f"a surface that ends at {', '.join(reached)} in {plural(loops, 'loop')}" if reached else "a closed surface"
    cavities = "" if reached else f", {plural(found.cavities, 'cavity', 'cavities')}"
    return (
        f"Proven: in the box {box} the level set is {kind}, with {plural(len(found), 'component')}, genus {found.genus}"
        f"{cavities} ({size})."
    )


def _open_places(proof: Proof) -> str:
    """Where nothing is proven."""
    scale = max(high - low for place in proof.places for low, high in zip(*place, strict=True))
    shown = [
        f"{position([(a + b) / 2 for a, b in zip(low, high, strict=True)], scale)}, "
        f"{max(b - a for a, b in zip(low, high, strict=True)):.2g} wide"
        for low, high in proof.places[:_SHOWN]
    ]
    more = len(proof.places) - len(shown)
    rest = f"; and {more} more" if more else ""
    return (
        f"{plural(proof.n_open, 'cell stays', 'cells stay')} open at {plural(len(proof.places), 'place')}, around "
        f"{'; '.join(shown)}{rest}"
    )
