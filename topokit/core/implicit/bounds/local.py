"""The network of a cell: where a piecewise linear function has few kinks, it is a small network of these alone.

In a box most ReLUs are on or off everywhere. What is left is a network of the kinks of open sign, in order,

    z_i = c_i + s_i · ε + Σ_{j<i} t_ij max(z_j, 0),    f = z_k,

with ε in [−1, 1]³ the place in the box. It bounds the smaller boxes inside without the function's own layers.

Rounding: every row has one number r_i that the errors of its coefficients, added up, do not exceed. As |ε| ≤ 1 and
0 ≤ max(z_j, 0) ≤ 1 (rows are scaled by powers of two), it bounds the error of the value, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.arrays import Floats, Integers
from topokit.core.implicit.bounds.program import Affine, Form, PositivePart, Program, affine

CENTER, SLOPES, ERROR, KINKS = 0, slice(1, 4), 4, 5
"""Columns of a row: c, s, r, and from there on t."""


@dataclass(frozen=True, eq=False)
class LocalNetworks:
    """The networks of N boxes with at most K kinks.

    Attributes:
        rows: (N, K + 1, K + 5) the rows of each, that of the function behind those of its kinks.
        count: (N,) kinks.
    """

    rows: Floats
    count: Integers


def local_networks(program: Program, forms: list[Form]) -> LocalNetworks:
    """The networks of boxes.

    Args:
        program: of affine steps and positive parts only.
        forms: of `program.forms` over the boxes.
    """
    like = forms[0].center
    found, rank, owner = [forms[0]], like.new_zeros(0, dtype=torch.int64), forms[0].owner
    count = torch.zeros(len(like), dtype=torch.int64)
    parts: list[_Rows] = []
    for step in program.steps:
        if isinstance(step, Affine):
            found.append(affine(step, [found[number] for number in step.inputs]))
            continue
        assert isinstance(step, PositivePart)
        low, high = forms[step.input].ends
        is_open = ~(low > 0) & ~(high < 0)
        box, entry = is_open.nonzero(as_tuple=True)
        order = count[box] + _place_in_run(box)
        scale = torch.exp2(torch.ceil(torch.log2(torch.maximum(high, -low)[box, entry])))
        parts.append(_rows(found[step.input], rank, box, entry, order, 1 / scale))
        found.append(_switched(found[step.input], (low > 0).to(low.dtype), owner, (box, entry, scale)))
        rank, owner = torch.cat((rank, order)), torch.cat((owner, box))
        count += is_open.sum(1)
    last = torch.arange(len(like))
    parts.append(_rows(found[-1], rank, last, 0 * last, count, like.new_ones(len(like))))
    most = int(count.max())
    rows = like.new_zeros(len(like), most + 1, most + KINKS)
    for part in parts:
        rows[part.box, part.order, : part.values.shape[1]] = part.values
    return LocalNetworks(rows.numpy(), count.numpy())


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows (m, KINKS + some) of boxes (m,) and their places there (m,)."""

    box: Tensor
    order: Tensor
    values: Tensor


def _place_in_run(box: Tensor) -> Tensor:
    """(m,) how many equal numbers stand before each of ascending ones."""
    return torch.arange(len(box)) - torch.searchsorted(box, box)


def _rows(form: Form, rank: Tensor, box: Tensor, entry: Tensor, order: Tensor, factor: Tensor) -> _Rows:
    """Entries (m,) of a form as rows, times a factor (m,)."""
    known = rank[: len(form.owner)]
    dense = form.center.new_zeros(len(form.center), int(known.max()) + 1 if len(known) else 0, form.center.shape[1])
    dense[form.owner, known] = form.kinks
    parts = (form.center[box, entry, None], form.slopes[:, box, entry].T, form.radius[box, entry, None])
    return _Rows(box, order, torch.cat((*parts, dense[box, :, entry]), dim=1) * factor[:, None])


def _switched(form: Form, is_on: Tensor, owner: Tensor, new: tuple[Tensor, Tensor, Tensor]) -> Form:
    """The positive part: what is on stays, what is open becomes a symbol, which is 1 where the scaled row is."""
    box, entry, scale = new
    kinks = form.kinks.new_zeros(len(box), form.kinks.shape[1])
    kinks[torch.arange(len(box)), entry] = scale
    return Form(
        torch.where(is_on > 0, form.center, 0.0),
        torch.where(is_on > 0, form.slopes, 0.0),
        torch.where(is_on > 0, form.radius, 0.0),
        torch.cat((form.padded(len(owner)) * is_on[owner], kinks)),
        torch.cat((owner, box)),
    )
