"""Enclosures of a program's gradient over boxes: zonotopes, found backward through the steps.

The gradient of Lipschitz functions is Clarke's: at kinks the hull of the gradients around. A kink of which a box may
hold both sides adds one generator of its own, which stays correlated with itself on its way back to the coordinates.
That keeps the sum of many kinks narrow where intervals would not.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.implicit.bounds.curves import Curve
from topokit.core.implicit.bounds.program import Affine, Bent, Form, PositivePart, Product, Program, by_mean_value
from topokit.core.implicit.bounds.rounding import gamma, up, widened

_STEPS = 16  # of the search for a shortest vector: one is enough for a single generator
_LOST = 1e-250  # far more than products of tiny numbers can lose, which derivatives do not keep account of


@dataclass(frozen=True, eq=False)
class Zonotopes:
    """Sets c + Σ [−1, 1] g_k + [−r, r] of vectors of n entries.

    Attributes:
        center: (N, n).
        generators: (M, n), those of all sets.
        owner: (M,) the set to which each belongs.
        radius: (N, n); NaN where nothing is known.
    """

    center: Tensor
    generators: Tensor
    owner: Tensor
    radius: Tensor

    @property
    def spread(self) -> Tensor:
        """(N, n) sums of the generators' magnitudes."""
        return torch.zeros_like(self.center).index_add(0, self.owner, self.generators.abs())

    @property
    def size(self) -> Tensor:
        """(N, n) largest magnitudes."""
        return up(self.center.abs() + self.spread * (1 + 1e-10) + self.radius)

    def rows(self, chosen: Tensor) -> Zonotopes:
        """Some of the sets, given by their numbers in ascending order."""
        place = torch.full((len(self.center),), -1)
        place[chosen] = torch.arange(len(chosen))
        kept = place[self.owner] >= 0
        return Zonotopes(self.center[chosen], self.generators[kept], place[self.owner[kept]], self.radius[chosen])

    def taken(self, chosen: Tensor) -> Zonotopes:
        """Some of the sets, given by numbers in any order, also more than once."""
        order = torch.argsort(self.owner, stable=True)
        count = torch.bincount(self.owner, minlength=len(self.center))
        first = count.cumsum(0) - count
        owner = torch.repeat_interleave(count[chosen])
        place = torch.arange(len(owner)) - (count[chosen].cumsum(0) - count[chosen])[owner]
        generators = self.generators[order[first[chosen][owner] + place]]
        return Zonotopes(self.center[chosen], generators, owner, self.radius[chosen])

    @staticmethod
    def joined(parts: list[Zonotopes]) -> Zonotopes:
        """Several collections as one."""
        starts = [0, *torch.tensor([len(part.center) for part in parts]).cumsum(0).tolist()]
        owners = [part.owner + start for part, start in zip(parts, starts[:-1], strict=True)]
        return Zonotopes(
            torch.cat([part.center for part in parts]),
            torch.cat([part.generators for part in parts]),
            torch.cat(owners),
            torch.cat([part.radius for part in parts]),
        )

    def least(self, directions: Tensor) -> Tensor:
        """A lower bound of ⟨d, η⟩ over the sets, with rounding errors.

        Args:
            directions: (N, J, n), J for each set.

        Returns:
            (N, J); NaN where nothing is known.
        """
        shadow = directions.new_zeros(directions.shape[:2])
        for rows in torch.arange(len(self.owner)).split(1 << 18):
            owner = self.owner[rows]
            shadow.index_add_(0, owner, (directions[owner] * self.generators[rows, None]).sum(2).abs())
        middle = (directions * self.center[:, None]).sum(2)
        shadow = shadow + (directions.abs() * self.radius[:, None]).sum(2)
        error = 1e-12 * (directions.abs() * self.size[:, None]).sum(2)
        return middle - shadow * (1 + 1e-10) - error - _LOST

    def lowest(self, directions: Tensor) -> Tensor:
        """(N, n) the vector of each set that points least along a direction, (N, n)."""
        along = (directions[self.owner] * self.generators).sum(1, keepdim=True).sign()
        corner = self.center - self.radius * directions.sign()
        return corner.index_add(0, self.owner, -along * self.generators)

    def shortest(self) -> Tensor:
        """(N, n) about the shortest vector of each set: if it is not 0, all of them point along it.

        Reference:
            Frank and Wolfe, "An algorithm for quadratic programming", Naval Research Logistics Quarterly 3, 1956.
        """
        found = self.center
        for _ in range(_STEPS):
            found = nearer_to_zero(found, self.lowest(found))
        return found


def nearer_to_zero(one: Tensor, other: Tensor) -> Tensor:
    """(N, n) the points nearest to 0 on segments from one point to another."""
    step = other - one
    share = -(one * step).sum(1) / (step * step).sum(1).clamp(min=_LOST)
    return one + share.clamp(0, 1)[:, None] * step


def count_kinks(program: Program, forms: list[Form]) -> Tensor:
    """(N,) kinks of which boxes may hold both sides."""
    total = torch.zeros(len(forms[0].center), dtype=torch.int64, device=forms[0].center.device)
    for step in program.steps:
        if isinstance(step, PositivePart):
            low, high = forms[step.input].ends
            total += (~(low > 0) & ~(high < 0)).sum(1)
    return total


def gradients(program: Program, forms: list[Form]) -> Zonotopes:
    """The gradients of the last step, over the boxes of the forms: (N, 3) with generators.

    Args:
        program: its steps.
        forms: of `program.forms` over boxes.
    """
    n_boxes = len(forms[0].center)
    like = forms[-1].center
    n_symbols = 0 if program.is_piecewise_linear else 3
    one = _Slope(
        torch.ones_like(like), like.new_zeros(n_symbols, n_boxes, 1), torch.zeros_like(like), like.new_zeros(0, 1)
    )
    owner = torch.zeros(0, dtype=torch.int64, device=like.device)
    slopes: dict[int, _Slope] = {len(program.steps): one}
    for number in range(len(program.steps), 0, -1):
        if number not in slopes:
            continue
        slope, step = slopes.pop(number), program.steps[number - 1]
        if isinstance(step, Affine):
            for source, matrix in zip(step.inputs, step.matrices, strict=True):
                _collect(slopes, source, slope.through(matrix, owner))
        elif isinstance(step, Bent):
            _collect(slopes, step.input, slope.times(_slope_form(forms[step.input], step.curve), owner))
        elif isinstance(step, Product):
            _collect(slopes, step.left, slope.times(forms[step.right], owner))
            _collect(slopes, step.right, slope.times(forms[step.left], owner))
        else:
            back, owner = slope.through_kinks(forms[step.input], owner)
            _collect(slopes, step.input, back)
    found = slopes.get(0)
    if found is None:  # it does not depend on the point
        nothing = like.new_zeros(n_boxes, 3)
        return Zonotopes(nothing, nothing[:0], owner[:0], nothing)
    shared = found.symbols.reshape(-1, 3)
    everywhere = torch.arange(n_boxes, device=like.device).repeat(n_symbols)
    generators = torch.cat((found.padded(len(owner)), shared))
    return Zonotopes(found.center, generators, torch.cat((owner, everywhere)), found.radius)


@dataclass(frozen=True, eq=False)
class _Slope:
    """Derivatives of the value with respect to a step's vector.

    Attributes:
        center: (N, n).
        symbols: (K, N, n), what the symbols of the box are multiplied with.
        radius: (N, n).
        kinks: (m, n), generators of the first m kinks.
    """

    center: Tensor
    symbols: Tensor
    radius: Tensor
    kinks: Tensor

    def padded(self, n_kinks: int) -> Tensor:
        """The generators of that many kinks: later ones do not occur."""
        return torch.cat((self.kinks, self.kinks.new_zeros(n_kinks - len(self.kinks), self.kinks.shape[1])))

    def from_kinks(self, owner: Tensor) -> Tensor:
        """(N, n) how far the kinks reach."""
        return torch.zeros_like(self.center).index_add(0, owner[: len(self.kinks)], self.kinks.abs())

    def through(self, matrix: Tensor, owner: Tensor) -> _Slope:
        """Back through an affine map."""
        error = gamma(matrix.shape[1])
        spread = self.center.abs() + self.symbols.abs().sum(0) + self.from_kinks(owner) * (1 + 1e-10)
        back = matrix.T
        radius = (self.radius + error * spread) @ back.abs()
        radius = torch.where(radius == 0, 0.0, widened(radius, 0.0, error))
        return _Slope(self.center @ back, self.symbols @ back, radius, self.kinks @ back)

    def times(self, factor: Form, owner: Tensor) -> _Slope:
        """Back through a product with what a form encloses, which is of no matter where the derivative is 0."""
        bend, n_symbols = factor.slopes, len(self.symbols)
        varies = factor.spread
        own = self.symbols.abs().sum(0) + self.from_kinks(owner) * (1 + 1e-10)
        whole = self.center.abs() + own + self.radius
        is_zero, whole = whole == 0, up(whole)
        symbols = factor.center * self.symbols
        if n_symbols and len(bend):
            symbols = symbols + self.center * bend
        rest = factor.radius + factor.from_kinks
        radius = factor.center.abs() * self.radius + rest * whole + varies * (own + self.radius)
        size = (factor.center.abs() + varies + factor.radius) * whole
        own_owner = owner[: len(self.kinks)]
        kinks = self.kinks * factor.center[own_owner]
        return _Slope(
            torch.where(is_zero, 0.0, factor.center * self.center),
            torch.where(is_zero, 0.0, symbols),
            torch.where(is_zero, 0.0, widened(radius, 4 * size)),
            torch.where(is_zero[own_owner], 0.0, kinks),
        )

    def through_kinks(self, form: Form, owner: Tensor) -> tuple[_Slope, Tensor]:
        """Back through positive parts: where the sign is open the factor is any of [0, 1], which is a new generator."""
        low, high = form.ends
        is_open = ~(low > 0) & ~(high < 0)
        factor = torch.where(is_open, 0.5, (low > 0).to(low.dtype))
        half = 0.5 * up(
            self.center.abs() + self.symbols.abs().sum(0) + self.radius + self.from_kinks(owner) * (1 + 1e-10)
        )
        box, entry = is_open.nonzero(as_tuple=True)
        new = self.kinks.new_zeros(len(box), self.kinks.shape[1])
        new[torch.arange(len(box), device=new.device), entry] = half[box, entry]
        is_off = factor == 0  # nothing comes through, not even what is not known
        kinks = torch.where(is_off[owner], 0.0, self.padded(len(owner)) * factor[owner])
        back = _Slope(
            torch.where(is_off, 0.0, factor * self.center),
            torch.where(is_off, 0.0, factor * self.symbols),
            torch.where(is_off, 0.0, factor * self.radius),
            torch.cat((kinks, new)),
        )
        return back, torch.cat((owner, box))


def _slope_form(form: Form, curve: Curve) -> Form:
    """The enclosure of a curve's slope: by its second derivative, or by its extremes where they are closer."""
    low, high = form.ends
    return by_mean_value(form, curve.slope(form.center), curve.bends(low, high), curve.slopes(low, high))


def _collect(slopes: dict[int, _Slope], number: int, more: _Slope) -> None:
    """Add derivatives along another path."""
    known = slopes.get(number)
    if known is None:
        slopes[number] = more
        return
    n_kinks = max(len(known.kinks), len(more.kinks))
    center, symbols = known.center + more.center, known.symbols + more.symbols
    size = known.center.abs() + more.center.abs() + known.symbols.abs().sum(0) + more.symbols.abs().sum(0)
    kinks = known.padded(n_kinks) + more.padded(n_kinks)
    slopes[number] = _Slope(center, symbols, widened(known.radius + more.radius, size), kinks)
