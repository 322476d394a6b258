"""A function of three coordinates as steps on vectors: affine maps, curves, positive parts and products.

A form encloses a vector over a box, x = c + Σ A_k ε_k ± r with ε_k in [−1, 1]: one ε for each coordinate of the box and
one for each kink before, so that what cancels does cancel.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

import torch
from torch import Tensor

from topokit.core.implicit.bounds import curves
from topokit.core.implicit.bounds.curves import Curve
from topokit.core.implicit.bounds.rounding import STEP, TINY, gamma, up, widened

_AT_ZERO = {curves.TANH: 0.0, curves.ATAN: 0.0, curves.ERF: 0.0, curves.SIGMOID: 0.5}  # these rise everywhere
_MOST_SYMBOLS = 48  # for kinks of one vector; further ones widen its radius


@dataclass(frozen=True, eq=False)
class Form:
    """Enclosures of N vectors of n entries.

    Attributes:
        center: (N, n).
        slopes: (K, N, n), what the K symbols are multiplied with; K is 3, or 0 at points.
        radius: (N, n), what is left, never negative; NaN where nothing is known.
        kinks: (m, n), what further symbols are multiplied with: those of the program's first m kinks.
        owner: (m,) the vector to which each kink belongs.
    """

    center: Tensor
    slopes: Tensor
    radius: Tensor
    kinks: Tensor
    owner: Tensor

    @property
    def from_kinks(self) -> Tensor:
        """(N, n) how far the symbols of kinks reach."""
        return torch.zeros_like(self.center).index_add(0, self.owner, self.kinks.abs()) * (1 + 1e-10)

    @property
    def spread(self) -> Tensor:
        """(N, n) how far all symbols reach."""
        return up(self.slopes.abs().sum(0) + self.from_kinks)

    @property
    def reach(self) -> Tensor:
        """(N, n) how far entries may be from the center."""
        return up(self.spread + self.radius)

    @property
    def ends(self) -> tuple[Tensor, Tensor]:
        """(N, n) lowest and highest values."""
        reach = widened(self.reach, self.center.abs())
        return self.center - reach, self.center + reach

    def rows(self, chosen: Tensor) -> Form:
        """Some of the N, by ascending number."""
        place = torch.full((len(self.center),), -1, device=chosen.device)
        place[chosen] = torch.arange(len(chosen), device=chosen.device)
        kept = (place[self.owner] >= 0).nonzero()[:, 0]
        owner = place[self.owner[kept]]
        return Form(self.center[chosen], self.slopes[:, chosen], self.radius[chosen], self.kinks[kept], owner)

    def padded(self, n_kinks: int) -> Tensor:
        """(n_kinks, n) the kinks, with later ones that do not occur here."""
        return torch.cat((self.kinks, self.kinks.new_zeros(n_kinks - len(self.kinks), self.kinks.shape[1])))


@dataclass(frozen=True, eq=False)
class Affine:
    """Σ x_i M_i + b.

    Attributes:
        inputs: steps that give x_i.
        matrices: (n_i, m) each.
        offset: (m,).
    """

    inputs: tuple[int, ...]
    matrices: tuple[Tensor, ...]
    offset: Tensor


@dataclass(frozen=True, eq=False)
class Bent:
    """A curve of every entry."""

    input: int
    curve: Curve


@dataclass(frozen=True)
class PositivePart:
    """max(x, 0) of every entry: the only kink there is, of which others are made."""

    input: int


@dataclass(frozen=True)
class Product:
    """x y, entry by entry."""

    left: int
    right: int


Step = Affine | Bent | PositivePart | Product


@dataclass(frozen=True, eq=False)
class Program:
    """Steps in order; step 0 is the point, the last one the value.

    Attributes:
        steps: all but the first.
        widths: entries of every step's vector, the first included.
    """

    steps: list[Step] = field(default_factory=list)
    widths: list[int] = field(default_factory=lambda: [3])

    @property
    def is_piecewise_linear(self) -> bool:
        """Whether its gradient is constant between kinks."""
        return all(isinstance(step, Affine | PositivePart) for step in self.steps)

    @property
    def has_kinks(self) -> bool:
        """Whether its gradient may jump."""
        return any(isinstance(step, PositivePart) for step in self.steps)

    def without_end(self) -> Program:
        """A program of the same signs, without a tanh, atan, erf or sigmoid at the end where that crosses 0 at 0."""
        slope = Fraction(1)  # of the value, and the value of the last curve at which it is 0
        offset = Fraction(0)
        for number in range(len(self.steps) - 1, -1, -1):
            step = self.steps[number]
            if isinstance(step, Affine) and step.inputs == (number,) and step.matrices[0].numel() == 1:
                offset += slope * Fraction(float(step.offset))
                slope *= Fraction(float(step.matrices[0]))
                continue
            if isinstance(step, Bent) and step.input == number and self.widths[number] == 1 and slope != 0:
                at_zero = _AT_ZERO.get(step.curve)
                if at_zero is not None and slope * Fraction(at_zero) + offset == 0:
                    sign = torch.full((1, 1), 1.0 if slope > 0 else -1.0, dtype=torch.float64)
                    steps = [*self.steps[:number], Affine((number,), (sign,), 0 * sign[0])]
                    return Program(steps, self.widths[: number + 2])
            break
        return self

    def to(self, device: torch.device) -> Program:
        """The program with its numbers on a device."""
        moved = [
            Affine(step.inputs, tuple(m.to(device) for m in step.matrices), step.offset.to(device))
            if isinstance(step, Affine)
            else step
            for step in self.steps
        ]
        return Program(moved, self.widths)

    def values(self, points: Tensor) -> Tensor:
        """(N, 1) the last step at points (N, 3), as torch computes it in float64."""
        found = [points]
        for step in self.steps:
            if isinstance(step, Affine):
                parts = [found[n] @ matrix for n, matrix in zip(step.inputs, step.matrices, strict=True)]
                found.append(sum(parts[1:], parts[0]) + step.offset)
            elif isinstance(step, Product):
                found.append(found[step.left] * found[step.right])
            else:
                x = found[step.input]
                found.append(x.clamp(min=0) if isinstance(step, PositivePart) else step.curve.value(x))
        return found[-1]

    def forms(self, centers: Tensor, half: Tensor) -> list[Form]:
        """Enclosures of every step over boxes.

        Args:
            centers: (N, 3), float64.
            half: (N, 3) half sides, which cover the rounding of the centers; or (0, 3) for the points themselves.
        """
        slopes = torch.diag_embed(half).permute(1, 0, 2) if len(half) else centers.new_zeros(0, *centers.shape)
        no_kinks = torch.zeros(0, dtype=torch.int64, device=centers.device)
        found = [Form(centers, slopes, torch.zeros_like(centers), centers[:0], no_kinks)]
        owner = no_kinks
        for step in self.steps:
            form = _enclosed(step, found, owner)
            owner = max(owner, form.owner, key=len)
            found.append(form)
        return found


def _enclosed(step: Step, found: list[Form], owner: Tensor) -> Form:
    if isinstance(step, Affine):
        return affine(step, [found[number] for number in step.inputs])
    if isinstance(step, Product):
        return product(found[step.left], found[step.right])
    form = found[step.input]
    return positive_part(form, owner) if isinstance(step, PositivePart) else bent(form, step.curve)


def affine(step: Affine, forms: list[Form]) -> Form:
    """The enclosure of an affine map."""
    owner = max((form.owner for form in forms), key=len)
    center: Tensor = step.offset
    slopes: Tensor | float = 0.0
    radius: Tensor | float = 0.0
    kinks: Tensor | float = 0.0
    error = gamma(sum(len(matrix) for matrix in step.matrices) + len(forms))
    for form, matrix in zip(forms, step.matrices, strict=True):
        center = center + form.center @ matrix
        slopes = slopes + form.slopes @ matrix
        kinks = kinks + form.padded(len(owner)) @ matrix
        radius = radius + (form.radius + error * (form.center.abs() + form.spread)) @ matrix.abs()
    return Form(center, slopes, widened(radius, step.offset.abs(), error), kinks, owner)  # type: ignore[arg-type]


def positive_part(form: Form, owner: Tensor) -> Form:
    """The enclosure of max(x, 0): the parallelogram of DeepZ where the sign is open.

    Its height is a symbol of its own, or part of the radius for vectors that have many.

    Args:
        form: of x.
        owner: of all kinks in earlier steps, those that x does not depend on included: new ones follow them.

    Reference:
        Singh, Gehr, Mirman, Püschel, Vechev, "Fast and effective robustness certification", NeurIPS 2018.
    """
    if not len(form.slopes):  # points: max(x, 0) does not enlarge errors
        return Form(form.center.clamp(min=0), form.slopes, form.radius, form.kinks, owner)
    low, high = form.ends
    is_open = ~(low > 0) & ~(high < 0)
    slope = torch.where(is_open, high / (high - low), (low > 0).to(low.dtype))
    shift = torch.where(is_open, -slope * low / 2, 0.0)
    error = torch.where(is_open, 8 * STEP * (form.center.abs() + form.reach) + TINY, 0.0)
    n_symbols = is_open.sum(1).index_add(0, owner, torch.ones_like(owner))
    is_symbol = is_open & (n_symbols <= _MOST_SYMBOLS)[:, None]
    box, entry = is_symbol.nonzero(as_tuple=True)
    new = form.kinks.new_zeros(len(box), form.kinks.shape[1])
    new[torch.arange(len(box), device=new.device), entry] = shift[box, entry]
    return Form(
        slope * form.center + shift,
        slope * form.slopes,
        slope * form.radius + torch.where(is_symbol, 0.0, shift) + error,
        torch.cat((slope[owner] * form.padded(len(owner)), new)),
        torch.cat((owner, box)),
    )


def bent(form: Form, curve: Curve) -> Form:
    """The enclosure of a curve: by the mean value theorem, or by its extremes where they are closer."""
    low, high = form.ends
    lowest, highest = curve.slopes(low, high)
    least, most = curve.values(low, high)
    value = curve.value(form.center)
    return by_mean_value(form, value, (lowest, highest), (least, most))


def by_mean_value(form: Form, value: Tensor, slopes: tuple[Tensor, Tensor], values: tuple[Tensor, Tensor]) -> Form:
    """The enclosure of a function of every entry.

    Args:
        form: encloses the arguments.
        value: the function at the centers, by torch.
        slopes: bounds of its derivative over the form.
        values: bounds of its values.
    """
    slope, spread = (slopes[0] + slopes[1]) / 2, (slopes[1] - slopes[0]) / 2
    reach = form.reach
    error = slope.abs() * form.radius + spread * reach
    middle, half = (values[0] + values[1]) / 2, (values[1] - values[0]) / 2
    is_linear = slope.abs() * form.spread + error < half
    size = 64 * (1 + value.abs()) + slope.abs() * reach
    return Form(
        torch.where(is_linear, value, middle),
        torch.where(is_linear, slope * form.slopes, 0.0),
        torch.where(is_linear, widened(error, size), widened(half, middle.abs())),
        torch.where(is_linear[form.owner], slope[form.owner] * form.kinks, 0.0),
        form.owner,
    )


def product(left: Form, right: Form) -> Form:
    """The enclosure of products, entry by entry."""
    owner = max(left.owner, right.owner, key=len)
    center = left.center * right.center
    slopes = left.center * right.slopes + right.center * left.slopes
    kinks = left.center[owner] * right.padded(len(owner)) + right.center[owner] * left.padded(len(owner))
    radius = left.center.abs() * right.radius + right.center.abs() * left.radius + left.reach * right.reach
    size = (left.center.abs() + left.reach) * (right.center.abs() + right.reach)
    return Form(center, slopes, widened(radius, 4 * size), kinks, owner)
