"""Sentences about the checks of a cloud's verdict and about how the cloud was prepared."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from topokit.core.cloud.evidence import Witness
from topokit.core.cloud.sheets import SheetReading
from topokit.core.cloud.votes import CUT_FAMILIES, values_of
from topokit.report.confidence import cloud_confidence
from topokit.report.doubts import is_noisy
from topokit.report.open_surface import OpenSurface
from topokit.report.verdict import Check
from topokit.report.wording import plural

if TYPE_CHECKING:
    from topokit.core.opacity.solid import OpacityReading

# name of the check: (sentence if it passed, sentence if it failed); see `_numbers` for what the fields hold
_SENTENCES = {
    "confidence": (
        "Answers with evidence like this are right {percent}% of the time, for features wider than {width:.2g}.",
        "Answers with evidence like this are right only {percent}% of the time, for features wider than {width:.2g}.",
    ),
    "points": ("", "{value:.0f} points are too few: how often so few are right was not measured."),
    "cuts": (
        "{n_cuts} of {cuts} Delaunay cuts give χ = {euler}.",
        "Only {n_cuts} of {cuts} Delaunay cuts give χ = {euler}{other_cuts}.",
    ),
    "fields": (
        "{n_fields} of {fields} winding-number fields give χ = {euler}.",
        "Only {n_fields} of {fields} winding-number fields give χ = {euler}{other_fields}.",
    ),
    "no fields": (
        "",
        "No winding-number field confirms the Delaunay cuts: grids as fine as the samples would be too large.",
    ),
    "coarse": (
        "",
        "Only {n_coarse} of {coarse} Delaunay cuts of half as many samples give χ = {euler}{other_coarse}: it changes "
        "with the number of samples.",
    ),
    "coverage": (
        "{value:.1%} of the points lie on the surface that was found.",
        "Only {value:.1%} of the points lie on the surface that was found.",
    ),
    "rim": (
        "",
        "{value:.0%} of the samples have neighbors on one side only: they lie along lines or around gaps, and the "
        "surface between them is unknown.",
    ),
    "boundary": (
        "",
        "{value:.0f} of the places that look like a boundary are covered by the surface that was found: they are taken "
        "for thin edges of a closed surface.",
    ),
    "genus": ("", "χ = {euler} is too large for {surfaces}: no genus fits it."),
    "double": (
        "",
        "Around {value:.0%} of the points the samples look like two sheets that were taken for one: a wall or a gap is "
        "thinner than the sample spacing.",
    ),
    "confirmed": (
        "{value:.1%} of the given normals are confirmed by the points.",
        "Only {value:.1%} of the given normals are confirmed by the points.",
    ),
    "contradictory": ("", "The given normals contradict each other: {value:.0%} point the wrong way."),
    "balls": (
        "The union of balls around the samples has χ = {euler}, too, for {value:.0%} of all radii, by weight.",
        "The surface with its rims has χ = {euler}, but the union of balls around the samples has it for only "
        "{value:.0%} of all radii, by weight{other_balls}.",
    ),
    "opacity": (
        "What cannot be seen into from outside has χ = {euler}, too, in {value:.0%} of its readings.",
        "What cannot be seen into from outside has χ = {euler} in only {value:.0%} of its readings{other_opaque}.",
    ),
    "hidden": (
        "",
        "{value:.0%} of the discs lie inside what cannot be seen into: they are walls of cavities or passages that are "
        "hidden.",
    ),
    "pieces": ("", "The union of balls has {ball_pieces}, not {components}."),
    "rims": ("", "Every part of an open surface has a rim, but only {value:.0f} could be traced."),
    "ring": (
        "",
        "Closed in the planes of its holes the surface has genus {genus}; with a disc in every rim it {disc_genus}. A "
        "cap has several rims, as under a ring that lies on a table: whether it is so was not seen.",
    ),
    "averaged": (
        "",
        "The points are as noisy as a plate thinner than the noise would be: whether the surface is open was not seen.",
    ),
    "wire_range": (
        "The walls of this cloud are thinner than its samples resolve: it is read as the surface of wires. The union "
        "of balls around the points gives χ = {euler} for radii from {smallest:.2g} to {largest:.2g} sample spacings, "
        "a ratio of {value:.2g}.",
        "The walls of this cloud are thinner than its samples resolve: it is read as the surface of wires. The union "
        "of balls around the points gives χ = {euler} only for radii from {smallest:.2g} to {largest:.2g} sample "
        "spacings.",
    ),
    "wire_share": (
        "{value:.0%} of all radii, by weight, give that integer.",
        "Only {value:.0%} of all radii of the balls, by weight, give χ = {euler}.",
    ),
    "wire_contrast": (
        "The next integer has 1/{value:.2g} of their weight.",
        "The next integer has 1/{value:.2g} of their weight.",
    ),
    "wire_narrowness": (
        "",
        "Neighborhoods of 100 points are not one-dimensional (ratio of variances {value:.2f}): wires run close to each "
        "other.",
    ),
    "rounding": (
        "",
        "So far from the origin single precision rounds coordinates to steps of {value:.2g} sample spacings, and "
        "details are lost: subtract an offset before they are stored.",
    ),
}


def check_sentences(
    checks: tuple[Check, ...], witness: Witness, seen: OpacityReading | None = None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """One sentence for each check that has something to say: those that decided the verdict, and the others.

    Every check decides a likely answer; the failed ones decide an unsure one.
    """
    numbers = _numbers(witness)
    if seen is not None:
        is_same = seen.euler == witness.euler
        numbers["other_opaque"] = "" if is_same else f" and χ = {seen.euler} in {seen.share:.0%}"
    return _divided(checks, numbers)


def opaque_sentence(seen: OpacityReading, closed: Witness | None) -> str:
    """That the integer is that of opacity, and not of the samples, whose evidence is given if they have no holes."""
    alone = "have holes, which other splats cover" if closed is None else f"give χ = {closed.euler}"
    return (
        f"What cannot be seen into from outside has χ = {seen.euler} in all {len(seen.eulers)} readings; the samples "
        f"alone {alone}."
    )


def open_sentences(
    checks: tuple[Check, ...], sheet: SheetReading | None, surface: OpenSurface
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The same for an open cloud."""
    euler, genus, disc_genus = surface.euler, surface.genus, surface.disc_genus
    numbers: dict[str, object] = {"euler": euler, "components": surface.components, "genus": genus}
    numbers["disc_genus"] = "has none" if disc_genus is None else f"has genus {disc_genus}"
    if sheet is not None:
        value, share = next(iter(sheet.shares.items()))
        numbers["other_balls"] = "" if value == euler else f"; {share:.0%} give χ = {value}"
        numbers["ball_pieces"] = plural(sheet.components, "part")
    return _divided(checks, numbers)


def cap_sentences(surface: OpenSurface) -> tuple[str, ...]:
    """That planar caps close an open cloud, if they do and the genus is not doubtful for it."""
    if surface.capped_genus is None or surface.has_ring:
        return ()
    return (f"Samples in the planes of its holes close the surface, too, with genus {surface.capped_genus}.",)


def _divided(checks: tuple[Check, ...], numbers: Mapping[str, object]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    failed = tuple(check for check in checks if not check.passed)
    deciding = failed or checks
    others = tuple(check for check in checks if check not in deciding)
    return _sentences(deciding, numbers), _sentences(others, numbers)


def _sentences(checks: tuple[Check, ...], numbers: Mapping[str, object]) -> tuple[str, ...]:
    found = []
    for check in checks:
        name = "no fields" if check.name == "fields" and not numbers["fields"] else check.name
        found.append(_SENTENCES[name][0 if check.passed else 1].format(value=check.value, **numbers))
    return tuple(sentence for sentence in found if sentence)


def confidence_sentences(witness: Witness, hole: float) -> tuple[str, ...]:
    """What the confidence counts beside the votes and the samples off the surface, and for which widths it holds.

    Args:
        witness: the evidence.
        hole: width of the narrowest round hole in the surface that is told from a gap between samples.
    """
    if witness.wire is not None:
        return ()
    quality, coarse = witness.quality, values_of(witness.votes, "coarse cut")
    return (
        f"{coarse.count(witness.euler)} of {len(coarse)} cuts of half as many samples give χ = {witness.euler}.",
        f"{quality.crowded_wide:.2%} of the points see an opposite sheet within 2.5 sample spacings.",
        _resolution_sentence(witness, hole),
    )


def _resolution_sentence(witness: Witness, hole: float) -> str:
    """Which features the samples show."""
    seen = (
        f"The samples show tunnels, walls, gaps, cavities and parts wider than {witness.resolution:.2g}, and holes in "
        f"the surface wider than {max(hole, witness.resolution):.2g}"
    )
    return f"{seen}{'; noise hides narrower ones' if is_noisy(witness) else ''}."


def preparation_sentences(witness: Witness) -> tuple[str, ...]:
    """How the points were reduced and where their normals come from, where that is worth saying."""
    sentences = []
    n_points, n_used = witness.n_points, witness.n_used
    if witness.preparation == "averaged":
        sentences.append(
            f"The noise is larger than the distances between the {n_points} points: {n_used} evenly spread samples, "
            "moved onto the planes of their neighborhoods, were used."
        )
    elif witness.preparation == "wire":
        sentences.append(f"{n_used} evenly spread samples of the {n_points} points were used.")
    elif witness.preparation == "sampled":
        sentences.append(
            f"Normals come from all {n_points} points, the integer from {n_used} samples of them, taken densely where "
            "features are small."
        )
    elif n_used < n_points:
        sentences.append(
            f"{plural(n_points - n_used, 'point')} that coincide with others, or nearly do, were left out."
        )
    if witness.is_shifted:
        sentences.append(
            "Some walls or gaps are thinner than the samples resolve: they were shifted along their normals before the "
            "integer was counted."
        )
    if witness.is_smoothed:
        sentences.append(
            "The votes on the noisy points differed: those on smoothed points, whose normals were found anew, were "
            "added."
        )
    if witness.wire is not None and witness.wire.n_stray:
        sentences.append(f"{plural(witness.wire.n_stray, 'point')} far from all wires were left out.")
    signs = witness.signs
    if signs.source == "reversed":
        sentences.append(f"The given normals point inward ({signs.confirmed:.0%} agree); they were reversed.")
    if signs.coverage is not None:
        what = "No normals were given; they" if signs.source == "none" else "The signs of the normals"
        sentences.append(
            f"{what} were found from the points ({signs.coverage:.0%} of them lie on the surface that the result "
            "implies)."
        )
    return tuple(sentences)


def outlier_sentences(n_outliers: int) -> tuple[str, ...]:
    """How many points were left out because they are off the surface, if any."""
    if n_outliers == 0:
        return ()
    what, was = ("1 point lies", "was") if n_outliers == 1 else (f"{n_outliers} points lie", "were")
    return (f"{what} off the surface, far from {'its' if n_outliers == 1 else 'their'} neighbors, and {was} left out.",)


def floater_sentence(width: float, resolution: float) -> str:
    """That something was dropped which the answer claims to see."""
    return (
        f"A cluster {width:.2g} wide was dropped as a floater, though the answer is about parts wider than "
        f"{resolution:.2g}: min_cluster_share=None counts it, component='largest' leaves it out by choice."
    )


def _numbers(witness: Witness) -> dict[str, object]:
    cuts, fields = values_of(witness.votes, *CUT_FAMILIES), values_of(witness.votes, "field")
    coarse = values_of(witness.votes, "coarse cut")
    return {
        "euler": witness.euler,
        "percent": int(100 * cloud_confidence(witness)),  # rounded down: 100 % would be a proof
        "width": witness.resolution,
        "cuts": len(cuts),
        "n_cuts": cuts.count(witness.euler),
        "other_cuts": _others(cuts, witness.euler),
        "coarse": len(coarse),
        "n_coarse": coarse.count(witness.euler),
        "other_coarse": _others(coarse, witness.euler),
        "fields": len(fields),
        "n_fields": fields.count(witness.euler),
        "other_fields": _others(fields, witness.euler),
        "surfaces": plural(witness.components + witness.cavities, "closed surface"),
        "smallest": 0.0 if witness.wire is None else witness.wire.smallest,
        "largest": 0.0 if witness.wire is None else witness.wire.largest,
    }


def _others(values: Sequence[int], euler: int) -> str:
    """The integers that the other votes give, from the most frequent one on."""
    counts = Counter(value for value in values if value != euler)
    return f", others {', '.join(str(value) for value, _ in counts.most_common())}" if counts else ""
