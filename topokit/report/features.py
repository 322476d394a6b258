"""Features by width, as the text and the page of a report show them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from topokit.core.grid.placement import Placement
from topokit.core.scale.features import Feature, SolidFeatures
from topokit.core.scale.narrow_places import NarrowPlace
from topokit.report.location import Place
from topokit.report.wording import FEATURES, plural, position

_MOST_TOLD = 10  # features that the text lists one by one
_MOST_DOUBTS = 3  # narrow places, likewise
_OTHERWISE = {"thin": "is not there", "narrow": "is closed", "small": "is filled"}
_WIDTH, _HEIGHT = 420, 120  # of the picture, in pixels


def feature_lines(
    found: SolidFeatures | None, doubts: Sequence[NarrowPlace] | None, placement: Placement | None
) -> tuple[str, ...]:
    """What the text of a report says: how many features there are from the narrowest width on, then one by one, and
    the places where the answer may be wrong."""
    features = () if found is None else _feature_lines(found, placement)
    return (*features, *(_doubt_lines(doubts) if doubts else ()))


def _doubt_lines(doubts: Sequence[NarrowPlace]) -> Iterator[str]:
    yield f"{plural(len(doubts), 'place is', 'places are')} doubtful, narrower than the resolution or off the surface:"
    for one in doubts[:_MOST_DOUBTS]:
        yield f"{one.kind.capitalize()}, {one.width:.3g} wide, at {position(one.place, one.width)}: {_otherwise(one)}."
    if len(doubts) > _MOST_DOUBTS:
        widest = max(one.width for one in doubts[_MOST_DOUBTS:])
        yield f"{plural(len(doubts) - _MOST_DOUBTS, 'more place')}, up to {widest:.3g} wide."


def _otherwise(doubt: NarrowPlace) -> str:
    """What would be if a doubt is right."""
    if doubt.change is None:
        return "the surface that was found does not pass through them"
    votes = f", as {doubt.votes:.0%} of the votes count" if doubt.votes else ""
    return f"χ changes by {doubt.change:+d} if it {_OTHERWISE[doubt.kind.split()[0]]}{votes}"


def _feature_lines(found: SolidFeatures, placement: Placement | None) -> tuple[str, ...]:
    counts = found.above(found.finest)
    solid = ", ".join(plural(n, *names) for n, names in zip(counts, FEATURES, strict=True))
    less = [plural(n, *names) for n, names in zip(found.narrower, FEATURES, strict=True) if n > 0]
    rest = f"; narrower: {', '.join(less)}" if less else ""
    many = found.features[_MOST_TOLD:]
    more = [f"{plural(len(many), 'more feature')}, up to {many[-1].width:.3g} wide."] if many else []
    return (
        f"At least {found.finest:.3g} wide: {solid} (χ {counts.euler}{rest}). Widths err by up to {found.error:.1g}.",
        *(_line(one, placement) for one in found.features[:_MOST_TOLD]),
        *more,
    )


def _line(one: Feature, placement: Placement | None) -> str:
    where = Place.of(one.place, placement) or position(one.place, one.width)
    if one.kind == "part":
        gap = "" if one.opening == float("inf") else f", {one.opening:.3g} from the next"
        return f"Part: {one.thickness:.3g} thick{gap}, at {where}."
    what = "handle" if one.kind == "tunnel" else "wall"
    return f"{one.kind.capitalize()}: {one.opening:.3g} wide, its {what} {one.thickness:.3g} thick, at {where}."


@dataclass(frozen=True)
class StepPicture:
    """χ of the features from each width on, as a step function in a drawing.

    Attributes:
        points: corners of the line in pixels, as SVG's polyline takes them.
        ticks: place along the axis of each width, its text, and χ from there on.
        width, height: of the drawing in pixels.
    """

    points: str
    ticks: tuple[tuple[float, str, int], ...]
    width: int = _WIDTH
    height: int = _HEIGHT


def step_picture(found: SolidFeatures) -> StepPicture:
    """The step function of a solid's features; widths along the axis in equal steps, since they range over decades."""
    curve = found.curve()
    eulers = [euler for _, euler in curve]
    low, span = min(eulers), max(max(eulers) - min(eulers), 1)
    step = _WIDTH / len(curve)
    corners, ticks = [], []
    for number, (width, euler) in enumerate(curve):
        height = _HEIGHT * (0.85 - 0.7 * (euler - low) / span)
        corners += [(number * step, height), ((number + 1) * step, height)]
        ticks.append((number * step, f"{width:.3g}", euler))
    return StepPicture(" ".join(f"{x:.1f},{y:.1f}" for x, y in corners), tuple(ticks))
