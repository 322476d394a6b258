"""Every number of the reconstruction of a cloud, with its unit, its meaning and the measurement that it comes from.

The numbers are passed down and never changed globally. `docs/thresholds.md` is made from them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

REAL = "47 closed real meshes, 10 000 random points each, clean and with 0.5 % noise"
DENSE = "the same meshes, 200 000 random points each"
WIRES = "67 tubes along random graphs, knots, polyhedra, helices and chained rings, 1 500 to 10 000 points"
GEOMETRY = "the geometry of random samples of a plane"
COST = "time and memory on two processors (benchmarks/bench_global.py, benchmarks/large_cloud.py)"
STRAY = (
    "47 closed real meshes, 10 000 random points each: none is left out; of 1 to 20 % of uniform points in boxes of 1 "
    "to 10 times the size, 20 to 99 % are"
)
NOISY = "plates, chairs and mugs with noise of 0.5 to 2 % of their length, 10 000 to 200 000 points"


def _number(value: object, unit: str, meaning: str, source: str) -> Any:
    """A setting's default with what `docs/thresholds.md` says about it."""
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "source": source})


@dataclass(frozen=True)
class GuardSettings:
    """What no surface can be read from."""

    far: float = _number(
        30.0, "ratio", "distance of a stray point from the middle over that of nine tenths of the points", REAL
    )
    fewest_in_space: int = _number(
        10_000, "points", "from which noise, walls and space can be told apart", "blobs, lattices and noise"
    )
    round: float = _number(
        0.52,
        "ratio of extents",
        "least roundness of neighborhoods of points that fill space",
        "real shapes of 3 000 to 200 000 points: at most 0.51 (1 % noise), 0.56 (2 %); blobs and boxes: at least 0.529",
    )
    round_sizes: tuple[int, ...] = _number(
        (16, 32, 64, 128), "neighbors", "of neighborhoods whose roundness counts", REAL
    )


@dataclass(frozen=True)
class PatchSettings:
    """Neighborhoods of points."""

    graph: int = _number(
        8,
        "neighbors",
        "that signs are carried to, and of the disc that a point stands for; shifts are averaged over them, twice",
        GEOMETRY,
    )
    plane: int = _number(10, "neighbors", "of a point's plane: few, so that sheets close together are not mixed", REAL)
    spacing: int = _number(16, "neighbors", "of a sample over which the local spacing is averaged", REAL)
    wide: int = _number(39, "neighbors", "of a sample among which opposite sheets are looked for", GEOMETRY)
    same_sheet: float = _number(0.3, "cosine", "of normals above which neighbors lie on one sheet", GEOMETRY)
    refit: int = _number(12, "neighbors", "of planes that are fitted anew once signs are known", REAL)
    refit_cosine: float = _number(
        0.5,
        "cosine",
        "of normals from which neighbors are on one sheet; from its negative they are on opposite ones",
        REAL,
    )
    fewest_refitted: int = _number(5, "neighbors", "that must count in such a plane", REAL)


@dataclass(frozen=True)
class DoubleSettings:
    """Two sheets that were taken for one."""

    neighbors: int = _number(64, "neighbors", "whose heights are compared: fewer hide two peaks in their scatter", REAL)
    thick: float = _number(0.12, "spacings", "standard deviation of heights, at least", REAL)
    two_peaks: float = _number(
        1.0,
        "kurtosis",
        "of heights above a quadric below that of Gaussian noise, at least",
        "spheres with noise of 0.2 to 1 spacing: at most 0.6 % of the neighborhoods; two spheres 0.5 to 2 spacings "
        "apart: 80 to 100 % without noise, 10 to 90 % with noise of 0.2 to 0.4 spacings",
    )
    share: float = _number(
        0.1,
        "share of neighborhoods",
        "with two peaks, beyond which points off their plane are two sheets and no noise",
        "closed real meshes with noise of 0.5 to 1 % of their size: at most 0.09; with walls of 0.3 to 2 spacings and "
        "less noise than a quarter of these: at least 0.17",
    )


@dataclass(frozen=True)
class CreaseSettings:
    """Planes of single faces near creases."""

    flat: float = _number(
        0.1, "ratio", "median thickness over size of neighborhoods up to which creases show", "noise of 0.15 spacings"
    )
    narrow: int = _number(6, "neighbors", "of planes that lie on one face near a crease", REAL)
    rounds: int = _number(3, "neighbors", "over which a face's plane is handed on", REAL)
    flatter: float = _number(
        0.125, "ratio", "misfit of a face's plane over a point's own below which it is taken", REAL
    )


@dataclass(frozen=True)
class SignSettings:
    """Signs carried along the surface."""

    roughness: float = _number(
        0.3, "spacings", "roughness up to which signs are carried; noise beyond it is averaged", DENSE
    )
    smooth: float = _number(
        0.05,
        "bending",
        "of a step that decides alone, within a patch",
        "of 18 million such steps of 24 shapes 6 in 100 000 are wrong",
    )
    most_patches: int = _number(
        50_000, "patches", "that vote on their signs; of more steps the lighter ones decide", COST
    )


@dataclass(frozen=True)
class OrientationSettings:
    """The choice between orientations."""

    believed: float = _number(
        0.996,
        "share of samples",
        "on the implied solid, of all and of every part, from which carried signs are believed",
        "47 closed real meshes, two draws of 10 000 random points: at least 0.9967 on right ones but one, at most "
        "0.9954 on wrong ones",
    )
    interpolating: float = _number(
        0.97,
        "share of samples",
        "coverage from which a missed sample is a missed feature, not noise; of every part, if carried signs hold",
        REAL,
    )
    coverage_power: float = _number(9.0, "exponent", "of the coverage in the cost of clean samples", REAL)
    hidden: float = _number(0.5, "share of samples", "coverage below which no surface shows", DENSE)
    hopeless: float = _number(2.0, "ratio", "cost over the least one from which signs are not corrected", REAL)
    coarse_cells: float = _number(64, "cells", "of the coarse grid along the longest side", REAL)
    most_fine_cells: float = _number(160, "cells", "of the fine grid along the longest side, at most", COST)
    fine_cells_per_spacing: float = _number(1.2, "cells", "of the fine grid per sample spacing, and 30 more", REAL)
    iterations: int = _number(12, "steps", "of conjugate gradients on each grid", REAL)
    alternations: int = _number(8, "rounds", "of a descent step and a turn of all dipoles", REAL)
    sigmas: tuple[float, float] = _number((1.0, 0.7), "cells", "Gaussian of the first and of the last round", REAL)


@dataclass(frozen=True)
class GivenSettings:
    """The check of given normals."""

    consistent: float = _number(0.95, "share of normals", "along the field's descent, at least", REAL)
    largest_residual: float = _number(
        0.08, "winding number", "mean distance from one half at the samples, at most", REAL
    )
    cheaper: float = _number(
        0.9, "ratio", "cost of a found solid over that of the given normals that refutes them", REAL
    )


@dataclass(frozen=True)
class SamplingSettings:
    """How many points are used."""

    whole: int = _number(
        30_000, "points", "of the largest cloud that is used whole; boundaries are looked for on as many", COST
    )
    samples: int = _number(
        20_000, "samples", "of a larger cloud; half as many for comparison, twice as many in doubt", COST
    )
    most_points: int = _number(2_000_000, "points", "that are measured, evenly many along a curve", COST)
    crowd: float = _number(
        0.85,
        "points",
        "within half a spacing of a point, on average, from which groups of points count as one",
        "random samples of ten meshes: 0.66 to 0.70, less with noise; two scans, up to a third of a spacing apart: at "
        "least 0.92",
    )
    probes: int = _number(
        1000,
        "points",
        "at which filled space, groups of points, noise, thin walls and double sheets are looked for",
        COST,
    )


@dataclass(frozen=True)
class NoiseSettings:
    """Noise that is larger than the distances between points."""

    sizes: tuple[int, ...] = _number(
        (16, 32, 64, 128, 256, 512, 1024, 2048), "neighbors", "of neighborhoods in which noise is measured", NOISY
    )
    reach: float = _number(
        2.5, "standard deviations", "radius of the neighborhood whose plane a sample is moved to", NOISY
    )
    apart: float = _number(
        2.0, "standard deviations", "between samples: details below that are lost in the noise", NOISY
    )


@dataclass(frozen=True)
class CutWeights:
    """Weights of the terms of the cut's energy, per unit of separating area.

    Attributes:
        area: of the area itself.
        normal: of area that faces against the samples' normals.
        sphere: of area whose empty spheres are centered on it.
        side: of a tetrahedron on the wrong side of its vertices' normals, per unit of its surface.
    """

    area: float = 0.5
    normal: float = 3.0
    sphere: float = 4.0
    side: float = 1.0


@dataclass(frozen=True)
class CutSettings:
    """Minimum cuts of Delaunay tetrahedra."""

    weights: tuple[CutWeights, ...] = _number(
        (CutWeights(), CutWeights(1.5, 3.0, 6.0), CutWeights(0.3, 2.0, 2.0)), "energy", "terms of each cut", REAL
    )

    @property
    def first(self) -> CutWeights:
        """The weights that decide between orientations, and of the surface that is shown."""
        return self.weights[0]


@dataclass(frozen=True)
class FieldSettings:
    """Winding-number fields."""

    grids: tuple[tuple[float, float, int], ...] = _number(
        ((1.5, 1.5, 128**3), (2.0, 1.5, 160**3), (2.0, 2.5, 160**3)),
        "cells, cells, vertices",
        "cells per sample spacing, Gaussian smoothing and largest size of each field's grid",
        REAL,
    )
    most_points: int = _number(200_000, "points", "that a field is made from", COST)


@dataclass(frozen=True)
class QualitySettings:
    """Sheets that are close together, and the size of features that can be seen."""

    uncovered: float = _number(
        1.3,
        "spacings",
        "to the nearest point from which a place is uncovered",
        "random samples of a sphere: patches of up to 13 samples; holes of seven spacings in them: at least 25",
    )
    facing: float = _number(
        0.2,
        "cosine",
        "mean between a facet of the found surface and the normals at its corners, below which no sample supports it",
        "the end of a wall that was cut through: 0; 12 closed meshes, 5 000 and 10 000 points, clean and noisy, with "
        "normals of faces or of vertices: a larger patch of such facets in one, at most 14 samples",
    )
    lid: float = _number(
        25,
        "samples",
        "missing from a patch of the found surface; above it, the patch is a lid over a hole of a clean cloud",
        "a region where a random samples are expected is empty with probability exp(-a): 10 000 points from 12 closed "
        "meshes: at most 17; 175 clouds that planes, boxes and spheres cut from closed meshes (benchmarks/"
        "open_clouds.py)",
    )
    feature: float = _number(
        2.5, "spacings", "of the smallest feature that is seen in clean samples; nearer opposite sheets are close", REAL
    )
    blur: float = _number(4.0, "ratio", "added to it by noise, in units of its standard deviation", GEOMETRY)
    clean: float = _number(0.15, "spacings", "roughness of clean samples of curved surfaces", REAL)


@dataclass(frozen=True)
class ShiftSettings:
    """Shifts along the normals."""

    lengths: tuple[float, ...] = _number(
        (0.3, 0.6), "spacings", "by which samples are shifted; a wall without thickness needs one to be resolved", REAL
    )
    free: float = _number(3.0, "spacings", "beyond which another sheet does not matter", REAL)
    sideways: float = _number(0.7, "spacings", "by which the opposite sample of a sheet may lie aside", GEOMETRY)


@dataclass(frozen=True)
class WireSettings:
    """Unions of balls: around clouds that are one-dimensional everywhere, and around open ones."""

    sizes: tuple[int, ...] = _number(
        (25, 50, 100), "points", "of neighborhoods that are tested; the smallest hold a whole cross-section", WIRES
    )
    fewest_patches: int = _number(20, "neighborhoods", "of a size that the cloud must hold", WIRES)
    narrow: float = _number(
        0.3,
        "ratio of variances",
        "median second over first variance of neighborhoods of a wire, at most",
        "47 real shapes: at least 0.56; wires: mostly below 0.2",
    )
    samples: int = _number(10_000, "points", "that are read, evenly spread", COST)
    smallest: float = _number(1.0, "spacings", "radius of balls that close all gaps along a wire", WIRES)
    largest: float = _number(
        6.0, "spacings", "radius of balls that join wires, and distance of stray points from all others", WIRES
    )
    tail: float = _number(0.05, "share of weight", "left out at both ends of the range of radii", WIRES)
    open_radii: tuple[float, float] = _number(
        (1.7, 3.5),
        "spacings",
        "of the smallest balls around an open cloud, which close all gaps between samples, and of the largest",
        "130 open clouds that planes, boxes and spheres cut from closed meshes, 5 000 to 30 000 random points before",
    )


@dataclass(frozen=True)
class OutlierSettings:
    """Points that are left out before a cloud is examined; widths are distances to the eighth neighbor."""

    isolated: float = _number(
        1.5, "ratio", "width of an outlier's neighborhood over the median of its neighbors' widths", STRAY
    )
    sparse: float = _number(2.5, "ratio", "the same over the median of all, from which isolation is enough", STRAY)
    beside: float = _number(0.5, "widths", "distance of a less isolated outlier from the plane of its neighbors", STRAY)
    wide: float = _number(4.0, "ratio", "width among other outliers over the median of all", STRAY)
    round: float = _number(0.3, "ratio of extents", "roundness of neighborhoods among other outliers", STRAY)


@dataclass(frozen=True)
class CloudSettings:
    """All settings of `global_witness`."""

    guards: GuardSettings = GuardSettings()
    patches: PatchSettings = PatchSettings()
    doubles: DoubleSettings = DoubleSettings()
    creases: CreaseSettings = CreaseSettings()
    signs: SignSettings = SignSettings()
    orientation: OrientationSettings = OrientationSettings()
    given: GivenSettings = GivenSettings()
    sampling: SamplingSettings = SamplingSettings()
    noise: NoiseSettings = NoiseSettings()
    cuts: CutSettings = CutSettings()
    fields: FieldSettings = FieldSettings()
    quality: QualitySettings = QualitySettings()
    shifts: ShiftSettings = ShiftSettings()
    wires: WireSettings = WireSettings()
