"""TopologyReport: the topology of a surface, a verdict, reasons and evidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from topokit.core.components import SurfaceComponent
from topokit.core.grid.minkowski import MinkowskiNumbers
from topokit.core.grid.placement import Placement
from topokit.core.loops import BoundaryLoop, width_of
from topokit.core.mesh.solid_by_winding import EnclosedSolid
from topokit.core.scale.features import SolidCounts, SolidFeatures
from topokit.core.scale.narrow_places import NarrowPlace
from topokit.errors import GenusError, InputError
from topokit.report.features import feature_lines, step_picture
from topokit.report.location import Location
from topokit.report.verdict import Verdict
from topokit.report.wording import plural
from topokit.text import json_text, no_attribute, printable

if TYPE_CHECKING:
    from jinja2 import Environment

Betti = tuple[int, int, int]

_MOST_REASONS = 5  # that a short text gives all of
_MOST_COMPONENTS = 50  # rows of the table in HTML; a scan can have thousands of components


@dataclass(frozen=True)
class Evidence:
    """One way in which the Euler characteristic was found.

    Attributes:
        name: what was computed.
        value: the raw value.
        integer: the integer it stands for, or None.
        seconds: time it took.
    """

    name: str
    value: float
    integer: int | None
    seconds: float = field(compare=False)


_OTHER_WORDS = {
    "betti": "surface_betti and solid_betti",
    "boundaries": "boundary_loops, or the shape's boundaries()",
    **dict.fromkeys(("is_closed", "is_watertight", "watertight"), "closed"),
    "n_components": "components",
}


@dataclass(frozen=True)
class TopologyReport:
    """The topology of a surface and how far it may be believed.

    Attributes:
        name: what was examined.
        euler: Euler characteristic χ of the surface, summed over components: the best integer there is, whatever the
            verdict; None only if nothing is known.
        genus: handles summed over components, g = (2c − b − χ)/2 for c components and b boundary loops (of open clouds
            see `rim_widths`), or None: no orientable surface has these numbers, or they are not known.
        components: connected components of the surface (a hollow ball has two).
        cavities: components that bound a hole inside a solid, or None if unknown.
        surface_betti: Betti numbers (c, 2g, c) of a closed surface, else None.
        solid_betti: Betti numbers (components, tunnels, cavities) of the solid that a closed surface bounds, else None.
        boundary_loops: number of boundary loops, or None if they were not counted.
        closed: whether the surface is closed, as far as its samples show.
        verdict: "certain" is proven, by counting or by bounds; "likely" means that independent evidence agrees;
            "unsure" means that it does not, that there is too little of it, or that a cloud is open.
        reasons: sentences with their numbers; those that decided the verdict come first.
        evidence: all evidence.
        estimate: the Gauss–Bonnet estimate χ⁽⁰⁾ of `Shape.gauss_bonnet`, of a cloud without its outliers, or None if it
            was not computed.
        refined: the self-optimized χ⁽ᴷ⁾, or None if it was not computed.
        solid: the solid that a mesh encloses by winding number, or None if it was not computed.
        resolution: width of the narrowest feature that the evidence can see, in units of length; None if it is exact.
            The width of a tunnel, wall, gap, cavity or part is the diameter of the largest ball that fits at its
            narrowest place. A likely integer counts features wider than this; narrower ones may be counted or not.
        per_component: what is known about each component, largest area first.
        n_deciding: how many of the first reasons decided the verdict; they are marked wherever the report is shown.
        confidence: probability that `euler` is right: 1 for certain, calibrated for closed point clouds and splats,
            None where nothing was calibrated (networks, wires, open surfaces).
        location: where pieces, tunnels, cavities, handles, boundaries and defects are, or None if they were not looked
            for.
        placement: where the voxels of a volume are, else None. Reports of volumes speak of the solid first.
        level_range: levels at which pieces, tunnels and cavities of a field stay as reported, from the first value up
            to the second; None if it was not computed, or there are no levels.
        cut_out_euler: Δχ, what a volume that was cut from a larger body contributes to χ of that solid, in eighths;
            None unless it was opened with `edges="cut-out"`.
        connectivity_density: (1 − Δχ) / V for a volume V between the centers of its end layers, likewise.
        minkowski: volume, surface area and mean breadth of the solid by Crofton's formulas, with its χ; None if they
            were not computed. A periodic cell has those of one period, and a volume that was cut from a larger body
            what it contributes to those of that solid.
        features: parts, tunnels and cavities with their widths, or None if they were not measured.
        doubts: where the answer about a cloud may be wrong: places narrower than `resolution`, first those that most
            votes count otherwise, then those where several samples are off the surface. None if they were not looked
            for.
        rim_widths: of an open cloud, the longest side of the box of each rim, widest first. χ, components, boundary
            loops are those of the surface that ends there, and the genus is that with its holes closed: by planar caps
            where these close it, else by a disc in every rim.
        flipped: faces of a mesh against the majority's orientation in their component, or None if it is no mesh.
        inverted: closed components of a mesh that point inward without bounding a cavity, or None likewise.
        self_intersections: places where a mesh crosses itself, or None if they were not looked for (`locate`), or
            libigl is not installed.
        advice: what would help most, to be sure or to see narrower features; None if nothing is known to help. The
            text ends with it if the verdict is "unsure", or all reasons are given.
    """

    name: str
    euler: int | None
    genus: int | None
    components: int
    cavities: int | None
    surface_betti: Betti | None
    solid_betti: Betti | None
    boundary_loops: int | None
    closed: bool
    verdict: Verdict
    reasons: tuple[str, ...]
    evidence: tuple[Evidence, ...]
    estimate: float | None
    refined: float | None
    solid: EnclosedSolid | None
    resolution: float | None
    per_component: Sequence[SurfaceComponent]
    n_deciding: int = 0
    confidence: float | None = None
    location: Location | None = None
    placement: Placement | None = None
    level_range: tuple[float, float] | None = None
    cut_out_euler: float | None = None
    connectivity_density: float | None = None
    minkowski: MinkowskiNumbers | None = None
    features: SolidFeatures | None = None
    doubts: tuple[NarrowPlace, ...] | None = None
    rim_widths: tuple[float, ...] = ()
    flipped: int | None = None
    inverted: int | None = None
    self_intersections: int | None = None
    advice: str | None = None

    if not TYPE_CHECKING:  # a type checker would take any name for an attribute

        def __getattr__(self, attribute: str) -> object:
            known = [*dir(type(self)), *(one.name for one in fields(self))]
            raise AttributeError(no_attribute("a report", attribute, known, _OTHER_WORDS), name=attribute)

    @property
    def pieces(self) -> int | None:
        """Connected components of the solid that a closed surface bounds (a hollow ball is one), or None if unknown."""
        return None if self.solid_betti is None else self.solid_betti[0]

    @property
    def tunnels(self) -> int | None:
        """Tunnels of that solid, or None if unknown."""
        return None if self.solid_betti is None else self.solid_betti[1]

    @property
    def solid_euler(self) -> int | None:
        """Euler characteristic of that solid, half of that of its surface, or None if unknown."""
        return None if self.solid_betti is None or self.euler is None else self.euler // 2

    def above(self, width: float) -> SolidCounts:
        """How many parts, tunnels and cavities are at least so wide; `.euler` and `.genus` of it follow.

        Args:
            width: in units of length.

        Raises:
            InputError: if widths were not measured, or only from a larger width on.
        """
        if self.features is None:
            raise InputError("widths were not measured: ask for report(features=True), or for shape.features().")
        return self.features.above(width)

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionaries, lists, numbers and strings, ready for JSON; None for numbers that are not finite."""
        return plain(self) | {name: getattr(self, name) for name in ("pieces", "tunnels", "solid_euler")}

    def to_json(self, indent: int | None = None) -> str:
        """The report as JSON text; tuples become lists."""
        return json_text(self.to_dict(), indent=indent)

    def _headline(self) -> str:
        """The answer in one line: of a volume about the solid, of everything else about the surface."""
        if self.placement is not None and self.solid_betti is not None:
            solid = ", ".join(_solid_parts(self.solid_betti))
            return f"{solid} (χ of the solid {self.solid_euler}, of its surface {self.euler}), {self.verdict}"
        answer = "unknown" if self.euler is None else str(self.euler)
        parts = [f"Euler characteristic {answer} ({self.verdict}{self._claim()})"]
        if self.genus is not None:
            parts.append(f"genus {self.genus}{self._closing()}")
        parts.append(plural(self.components, "component"))
        parts.append("closed" if self.closed else "not closed")
        if self.solid_betti is not None and self.cavities:
            pieces, tunnels, cavities = _solid_parts(self.solid_betti)
            parts.append(f"bounding a solid of {pieces} with {tunnels} and {cavities}")
        return ", ".join(parts)

    def _closing(self) -> str:
        """Which rims of a cloud have to be closed."""
        if not self.rim_widths:
            return ""
        if len(self.rim_widths) == 1:
            return f" after closing 1 rim ({self.rim_widths[0]:.2g} wide)"
        return f" after closing {len(self.rim_widths)} rims (the largest {self.rim_widths[0]:.2g} wide)"

    def _claim(self) -> str:
        """Which features a likely integer counts."""
        if self.verdict != "likely" or self.resolution is None:
            return ""
        return f", for features wider than {self.resolution:.2g}"

    @property
    def _has_details(self) -> bool:
        """Whether it was asked for with details."""
        return not (self.refined is None and self.solid is None and self.level_range is None)

    def text(self, *, full: bool = False) -> str:
        """The report as people read it: the answer, its reasons and, if they were looked for, places.

        Args:
            full: whether to give all reasons. Otherwise more than five are shortened to the two that come first, or
                three if the verdict is "unsure"; `str(report)` does so. Details that were asked for are always given.
        """
        n_shown = n_reasons = len(self.reasons)
        if not (full or self._has_details) and n_reasons > _MOST_REASONS:
            n_shown = 3 if self.verdict == "unsure" else 2
        lines = [f"{self.name}: {self._headline()}"]
        lines += [f"  {'*' if number < self.n_deciding else '-'} {self.reasons[number]}" for number in range(n_shown)]
        if n_shown < n_reasons:
            more = plural(n_reasons - n_shown, "more reason")
            lines.append(f"  … {more}: report.text(full=True), or topokit report -v")
        lines += [f"  - {line}" for line in feature_lines(self.features, self.doubts, self.placement)]
        lines += [f"  - {place}" for place in (() if self.location is None else self.location.lines())]
        if self.advice is not None and (full or self.verdict != "likely"):
            lines.append(f"  Advice: {self.advice}")
        return "\n".join(map(printable, lines))

    def __str__(self) -> str:
        return self.text()

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return f'<style>{report_styles()}</style><div class="topokit">{report_html(self)}</div>'


def _solid_parts(solid: Betti) -> tuple[str, str, str]:
    pieces, tunnels, cavities = solid
    return plural(pieces, "piece"), plural(tunnels, "tunnel"), plural(cavities, "cavity", "cavities")


def plain(value: Any) -> Any:
    """Records as dictionaries, sequences as lists, numbers that are not finite as None."""
    if is_dataclass(value) and not isinstance(value, Sequence):
        named = (one.name for one in fields(value) if one.metadata.get("json", True))
        return {name: plain(getattr(value, name)) for name in named}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def why(report: TopologyReport) -> str:
    """The first of the reasons that decided the verdict, where the others are, and what helps unless it is likely."""
    if report.n_deciding == 0:
        return "Nothing is known about it."
    more = f" report() has {plural(report.n_deciding - 1, 'more reason')}." if report.n_deciding > 1 else ""
    advice = f" {report.advice}" if report.advice is not None and report.verdict != "likely" else ""
    return f"{report.reasons[0]}{more}{advice}"


def known_euler(report: TopologyReport) -> int:
    """The report's Euler characteristic.

    Raises:
        InputError: if it is unknown; the message says why.
    """
    if report.euler is None:
        raise InputError(f"{report.name}: the Euler characteristic is unknown. {why(report)}")
    return report.euler


def known_genus(
    report: TopologyReport,
    boundaries: Callable[[], Sequence[BoundaryLoop]],
    *,
    is_manifold: bool | None = None,
    cap: bool | float = True,
) -> int:
    """The report's genus.

    Args:
        report: of a shape.
        boundaries: traces the rims of an open surface of which the report has no widths.
        is_manifold: whether the surface was counted to be a manifold, or None if it was not.
        cap: whether the genus of an open surface is an answer, or how wide its rims may be.

    Raises:
        GenusError: if it is undefined or unknown, or a rim is wider; the message says why and which call says more.
        InputError: if that width is no positive number.
    """
    if not isinstance(cap, bool) and not cap > 0:
        raise InputError(f"cap is {cap!r}; expected True, False, or a positive width in units of length.")
    if report.genus is not None and (report.closed or cap is True):
        return report.genus
    if report.genus is not None and cap is not False:
        widest = max(report.rim_widths or [width_of(loop.bounds) for loop in boundaries()])
        if widest <= cap:
            return report.genus
        raise GenusError(
            f"{report.name}: a rim is {widest:.4g} wide, wider than cap={cap:g}. genus(cap=True) closes all rims."
        )
    if is_manifold:
        reason, call = "The surface is one-sided (not orientable).", f"shape.report().euler is {report.euler}."
    elif is_manifold is False:
        reason, call = why(report), "shape.defects() lists the places."
    elif report.boundary_loops:
        reason, call = why(report), "shape.boundaries() gives the curves along which it ends."
    else:
        reason, call = why(report), "shape.report() holds all evidence."
    raise GenusError(f"{report.name}: genus is undefined or unknown. {reason} {call}")


def report_html(report: TopologyReport) -> str:
    """The report as escaped HTML, without styles; `report_styles` has them.

    Args:
        report: any report.
    """
    shown = report.per_component[:_MOST_COMPONENTS]
    steps = None if report.features is None else step_picture(report.features)
    return environment().get_template("report.html").render(report=report, components=shown, steps=steps)


@cache
def report_styles() -> str:
    """The style sheet of reports; every rule is within the class topokit."""
    return files("topokit.report").joinpath("templates", "report.css").read_text(encoding="utf-8")


@cache
def environment(package: str = "topokit.report") -> Environment:
    """The templates of a package; everything that they insert is escaped, and texts of any origin are printable."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader(package),
        autoescape=True,
        finalize=lambda value: printable(value) if type(value) is str else value,  # not what is marked as HTML
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
