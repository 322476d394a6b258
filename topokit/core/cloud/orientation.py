"""Outward normals for samples whose signs are unknown.

Signs carried along a smooth surface are believed if the solid that they imply agrees with nearly all of them. Else
they compete with the directions of winding-number fields. The winding number of a closed surface is one half on the
surface. Solving w(pᵢ) = ½ for dipole vectors by regularized conjugate gradients in a Fourier operator needs no normals;
a few rounds of one steepest-descent step and a turn of every dipole along −∇w sharpen the result. This is done on a
coarse grid (robust to noise) and on one as fine as the sample spacing (right on thin sheets). The candidates are
compared by the cost of the best solid that each implies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from topokit.core.arrays import Booleans, Floats
from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.normals.dipoles import DipoleSolver
from topokit.core.cloud.normals.patches import Neighborhoods, turned_towards, unit
from topokit.core.cloud.sampling.samples_of_large_clouds import Samples
from topokit.core.cloud.settings import CloudSettings, OrientationSettings
from topokit.core.cloud.solid.poles import normals_by_poles
from topokit.core.cloud.solid.tetrahedra import Cut, DelaunayComplex, cut_complex, surface_normals


@dataclass(frozen=True, eq=False)
class Trial:
    """Normals (M, 3) of samples and the solid that they imply."""

    normals: Floats
    cut: Cut

    def cost(self, power: float = 1.0) -> float:
        """The energy of the cut, raised where samples are off its surface; finite."""
        return float(self.cut.energy / max(self.cut.coverage, 1e-3) ** power)


@dataclass(frozen=True, eq=False)
class Orientation:
    """Outward normals and how they were found.

    Attributes:
        normals: (M, 3), unit, outward: out of the solid, so into the cavity on a cavity's wall.
        coverage: share of the samples on the implied solid's surface.
        trials: every candidate, the chosen one first.
    """

    normals: Floats
    coverage: float
    trials: tuple[Trial, ...]

    def corrected(self, complex_: DelaunayComplex, axes: Floats | None, settings: CloudSettings) -> Trial:
        """The candidate that implies the cheapest solid once the poles have corrected its signs.

        Args:
            complex_: tetrahedra of the samples.
            axes: (M, 3), unit normals of arbitrary sign, where known.
            settings: candidates of a cost beyond a limit are not corrected.
        """
        own = settings.orientation
        power = own.coverage_power
        limit = own.hopeless * min(trial.cost(power) for trial in self.trials)
        found = [
            Trial(*normals_by_poles(complex_, trial.normals, trial.cut, settings.cuts.first, rounds=2, axes=axes))
            for trial in self.trials
            if trial.cost(power) <= limit
        ]
        return min(found, key=lambda trial: trial.cost(power))


def orient_samples(
    samples: Samples, local: Neighborhoods, complex_: DelaunayComplex, settings: CloudSettings
) -> Orientation:
    """Outward normals for samples.

    Args:
        samples: with signs carried along the surface, where it is smooth.
        local: their neighborhoods.
        complex_: their tetrahedra.
        settings: of the grids and the choice.
    """
    own, trials = settings.orientation, []
    if samples.signed is not None:
        carried = _trial(complex_, samples.refined(samples.signed, local, settings), settings)
        surface, is_on = surface_normals(complex_, carried.cut.inside, carried.normals)
        if _is_believed(is_on, samples, own):
            return Orientation(_outward(carried, surface, samples), carried.cut.coverage, (carried,))
        trials.append(carried)
    longest = float(np.ptp(local.points, axis=0).max())
    cells = own.fine_cells_per_spacing * longest / local.spacing
    coarse = min(own.coarse_cells, cells)  # between dipoles that are cells apart a field says nothing
    fine = min(cells + 30, own.most_fine_cells)
    for n_cells, is_fine in ((coarse, False), (fine, True)):
        solver = DipoleSolver(local.points, samples.areas, longest / n_cells)
        solved = solver.conjugate_gradients(own.sigmas[0], own.iterations)
        turned = solver.alternate(solved, *own.sigmas, own.alternations)
        directions = (solved, turned) if is_fine else (turned,)  # on thin sheets a turn may do harm
        for dipoles in directions:
            trials += [
                _trial(complex_, normals, settings) for normals in _candidates(dipoles, samples, local, settings)
            ]
    is_clean = max(trial.cut.coverage for trial in trials) >= own.interpolating
    trials.sort(key=lambda trial: trial.cost(own.coverage_power if is_clean else 1.0))
    surface, _ = surface_normals(complex_, trials[0].cut.inside, trials[0].normals)
    return Orientation(_outward(trials[0], surface, samples), trials[0].cut.coverage, tuple(trials))


def _trial(complex_: DelaunayComplex, normals: Floats, settings: CloudSettings) -> Trial:
    return Trial(normals, cut_complex(complex_, normals, settings.cuts.first))


def _outward(trial: Trial, surface: Floats, samples: Samples) -> Floats:
    """The normals of a trial, as far as they are known, with the signs of the surface that they imply."""
    if samples.axes is not None:
        return turned_towards(samples.axes, surface)
    return unit(surface + (1 + 1e-9) * trial.normals)  # they may cancel


def _is_believed(is_on: Booleans, samples: Samples, settings: OrientationSettings) -> bool:
    """Whether nearly all samples (M,) are on the surface of the solid, and no part of the cloud is off it.

    A cavity whose normals point out of it rather than into it is left out by the cut: however small, its part tells.
    """
    size = np.bincount(samples.parts)
    is_part = np.bincount(samples.parts[samples.owner]) >= FEWEST_POINTS  # of all points
    covered = np.bincount(samples.parts, is_on)[is_part] / size[is_part]
    least = settings.believed if samples.is_all else settings.interpolating
    return bool(min((is_on.mean(), *covered)) >= least)


def _candidates(dipoles: Tensor, samples: Samples, local: Neighborhoods, settings: CloudSettings) -> Iterator[Floats]:
    """Normals (M, 3) that follow dipoles: one by one, and by patches within which the signs agree."""
    direction = unit(dipoles.double().numpy())
    yield samples.refined(direction, local, settings)
    if samples.axes is not None and samples.signed is not None:
        along = (samples.signed * direction).sum(1)
        by_patch = np.where(np.bincount(samples.patches, samples.areas * along)[samples.patches] < 0, -1.0, 1.0)
        yield samples.signed * by_patch[:, None]
