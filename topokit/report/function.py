"""The answer of a function's level set: counts on grids that are refined until they agree."""

from __future__ import annotations

from topokit.core.components import Corner, CountedComponents
from topokit.core.implicit.convergence import ConvergenceStudy
from topokit.report.counted import CountedAnswer
from topokit.report.report import Evidence
from topokit.report.verdict import function_verdict
from topokit.report.wording import plural


def function_answer(
    found: ConvergenceStudy,
    has_distance: bool,
    components: CountedComponents,
    low: Corner,
    high: Corner,
    seconds: float,
) -> CountedAnswer:
    """The counted answer of a level set in a box.

    Args:
        found: counts on grids of growing resolution.
        has_distance: whether values are about the distance from the level set (see `unseen.carries_distance`).
        components: closed surfaces on the grid that was kept.
        low: lowest corner of the box.
        high: highest corner of the box.
        seconds: time the counts took.
    """
    faces = _face_names(found.reached_faces, low, high)
    adds_up = components.euler.sum() == found.euler
    verdict = function_verdict(
        found.has_converged,
        has_distance=has_distance,
        n_unseen=found.n_unseen,
        reaches_box=bool(faces),
        adds_up=bool(adds_up),
    )
    finest = found.counts[-1]
    deciding, others = _reasons(found, faces, has_distance=has_distance, adds_up=bool(adds_up))
    return CountedAnswer(
        evidence=Evidence(
            f"grids of {found.counts[0].n_cells} to {finest.n_cells} cells",
            float(finest.euler_6),
            found.euler,
            seconds,
        ),
        components=components,
        closed=not faces,
        boundary_loops=None if faces else 0,
        verdict=verdict,
        reasons=(*deciding, *others),
        n_deciding=len(deciding),
        resolution=2 * found.counts[-3].step,
        advice=_advice(finest.n_cells, bool(faces), has_distance),
    )


def _advice(n_cells: int, reaches_box: bool, has_distance: bool) -> str:
    """What to change in the call."""
    if reaches_box:
        return "Pass larger bounds, or tighter ones if the network invented a sheet outside its training box."
    if not has_distance:
        return "Use the values before the last activation, from_occupancy(logits=True), or a signed distance."
    return f"Pass a resolution of more than {n_cells} cells, or bounds around a part."


def _face_names(faces: tuple[tuple[bool, bool], ...], low: Corner, high: Corner) -> list[str]:
    return [
        f"{letter} = {corner:g}"
        for letter, pair, corners in zip("xyz", faces, zip(low, high, strict=True), strict=True)
        for reached, corner in zip(pair, corners, strict=True)
        if reached
    ]


def _reasons(
    found: ConvergenceStudy, faces: list[str], *, has_distance: bool, adds_up: bool
) -> tuple[list[str], list[str]]:
    """Sentences that decided the verdict, and the others."""
    deciding: list[str] = []
    if faces:
        deciding.append(f"The level set reaches the box, at {', '.join(faces)}: what is beyond was closed off there.")
    if not found.has_converged:
        deciding.append(_unsettled(found))
    elif not adds_up:
        deciding.append("The surfaces of the grid that is kept do not add up to that integer.")
    if found.n_unseen:
        deciding.append(
            f"At {plural(found.n_unseen, 'place')} of the last grid the function reaches its level between grid points "
            f"that are all on one side: parts thinner than {found.counts[-1].step:.3g} are missed."
        )
    if not has_distance:
        deciding.append(
            f"The function jumps to a constant within {found.first_step:.3g}, a cell of the first grid, so nothing "
            "tells where parts smaller than that may be."
        )
    share = found.n_evaluations / found.finest.n_vertices
    others = [
        f"Surface χ by counting on grids: {'; '.join(str(count) for count in found.counts)}.",
        f"{found.n_evaluations} points were evaluated, {100 * share:.1f} % of the finest grid's.",
    ]
    if found.has_converged:
        (others if deciding else deciding).insert(0, _settled(found))
    return deciding, others


def _settled(found: ConvergenceStudy) -> str:
    return (
        "Both connectivities agree on the last 3 grids, also with the level moved by up to a tenth of a cell's change; "
        f"they prove nothing about what lies between their points ({found.counts[-1].step:.3g} apart near the surface, "
        f"{found.first_step:.3g} elsewhere)."
    )


def _unsettled(found: ConvergenceStudy) -> str:
    counts = found.counts
    seen = sorted({value for count in counts for value in (count.euler_26, count.euler_6)} | set(found.shifted_eulers))
    return (
        f"The answer is not settled: {found.euler} was seen most often, of the values {', '.join(map(str, seen))}, "
        "those with the level moved by up to a tenth of a cell's change included; features near "
        f"{counts[-1].step:.3g} decide."
    )
