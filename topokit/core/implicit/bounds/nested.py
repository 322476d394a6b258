"""Bounds in boxes inside others, by the local networks of these: compiled loops over kinks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from topokit.core.arrays import Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.implicit.bounds.gradients import Zonotopes
from topokit.core.implicit.bounds.local import KINKS, LocalNetworks
from topokit.core.implicit.bounds.rounding import STEP, TINY

_STEP, _TINY = float(STEP), float(TINY)
_UP = 1 + 1e-10  # far more than sums of some hundred positive numbers can lose
_BASE = 5  # columns before those of the kinks


@dataclass(frozen=True, eq=False)
class Nested:
    """What is known about n boxes.

    Attributes:
        sign: (n,) 1 or −1 where the function has it everywhere, else 0.
        state: (n, K) for every kink of the network 1 if it is on everywhere, −1 if off, 0 if open.
        center, radius: (n, 3) of the gradient's enclosures, as in `Zonotopes`, in units of the network's ε.
        generators: (n, K, 3), of open kinks.
    """

    sign: Integers
    state: Integers
    center: Floats
    radius: Floats
    generators: Floats

    def gradient(self, chosen: Integers, half: Floats) -> Zonotopes:
        """The gradients in some boxes; half (3,) are the half sides of the networks' boxes."""
        box, kink = np.nonzero(self.generators[chosen].any(2))
        parts = (self.center[chosen], self.generators[chosen][box, kink], self.radius[chosen])
        center, generators, radius = (torch.from_numpy(part / half) for part in parts)
        widened = 8 * STEP * (center.abs() + radius) + radius
        spread = torch.zeros_like(center).index_add(0, torch.from_numpy(box), generators.abs())
        return Zonotopes(center, generators, torch.from_numpy(box), widened + 8 * STEP * spread)


def nested(networks: LocalNetworks, network: Integers, offset: Floats, scale: Floats) -> Nested:
    """Bounds in boxes.

    Args:
        networks: of larger boxes.
        network: (n,) the number of each box's network.
        offset: (n, 3) its center in the larger box's ε, exact.
        scale: (3,) its half sides there.
    """
    n, most = len(network), networks.rows.shape[2] - KINKS
    found = Nested(
        np.zeros(n, np.int64),
        np.zeros((n, most), np.int64),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.zeros((n, most, 3)),
    )
    _bound(networks.rows, networks.count, network, offset, scale, *_fields(found))
    return found


def restricted(networks: LocalNetworks, network: Integers, state: Integers) -> LocalNetworks:
    """The networks of boxes in which more kinks are settled; their ε stays that of the larger boxes.

    Args:
        networks: of larger boxes.
        network: (n,) as for `nested`.
        state: (n, K) as in `Nested`.
    """
    is_known = np.arange(state.shape[1]) >= networks.count[network, None]
    count = ((state == 0) & ~is_known).sum(1)
    most = int(count.max(initial=0))
    rows = np.zeros((len(network), most + 1, most + KINKS))
    _restrict(networks.rows, networks.count, network, state, rows)
    return LocalNetworks(rows, count)


def _fields(found: Nested) -> tuple[Integers, Integers, Floats, Floats, Floats]:
    return found.sign, found.state, found.center, found.radius, found.generators


@compiled
def _bound(
    rows: Floats,
    count: Integers,
    network: Integers,
    offset: Floats,
    scale: Floats,
    sign: Integers,
    state: Integers,
    center: Floats,
    radius: Floats,
    generators: Floats,
) -> None:
    most = rows.shape[1]
    form, error, size = np.empty((most, most + 4)), np.empty(most), np.empty(most)
    weight, lost = np.empty((most, most + 1)), np.empty(most)
    for box in range(len(network)):
        own, k = rows[network[box]], count[network[box]]
        sign[box] = _values(own, k, offset[box], scale, state[box], form, error, size)
        if sign[box] == 0:
            _gradient(own, k, state[box], weight, lost, center[box], radius[box], generators[box])
            farthest = 0.0
            for axis in range(3):
                total = abs(center[box, axis]) + radius[box, axis]
                for kink in range(k):
                    total += abs(generators[box, kink, axis])
                farthest += total * scale[axis]
            value, off = _at_point(own, k, offset[box], form[:, 0], error)
            if abs(value) - off > farthest * _UP:
                sign[box] = 1 if value > 0 else -1


@compiled
def _values(
    own: Floats, k: int, at: Floats, scale: Floats, state: Integers, form: Floats, error: Floats, size: Floats
) -> int:
    """The function's sign in a box, or 0; what the kinks do there is written to `state`.

    `form` has a row for every kink: its center, three slopes and its symbols; `error` what is left of it, and `size` no
    less than the sum of their magnitudes.
    """
    for i in range(k + 1):
        row, value = form[i], own[i]
        row[0] = value[0] + value[1] * at[0] + value[2] * at[1] + value[3] * at[2]
        total = abs(value[0])
        for axis in range(3):
            row[1 + axis] = value[1 + axis] * scale[axis]
            total += 2 * abs(value[1 + axis])
        row[4 : 4 + i] = 0.0
        rest = value[4]
        for j in range(i):
            factor = value[_BASE + j]
            if factor != 0 and state[j] >= 0:
                for m in range(5 + j):
                    row[m] += factor * form[j, m]
                rest += abs(factor) * error[j]
                total += abs(factor) * size[j]
        rest = (rest + (k + 16) * _STEP * total) * _UP + _TINY
        reach = rest
        for m in range(1, 4 + i):
            reach += abs(row[m])
        reach = reach * _UP + 8 * _STEP * abs(row[0])
        low, high = row[0] - reach, row[0] + reach
        if i == k:
            return 1 if low > 0 else -1 if high < 0 else 0
        size[i] = 2 * (abs(row[0]) + reach)
        row[4 + i] = 0.0
        error[i] = rest
        state[i] = 1 if low > 0 else -1 if high < 0 else 0
        if state[i] == 0:
            slope = high / (high - low)
            shift = -slope * low / 2
            for m in range(4 + i):
                row[m] *= slope
            row[0] += shift
            row[4 + i] = shift
            error[i] = slope * rest + 16 * _STEP * size[i] + _TINY
    return 0


@compiled
def _gradient(
    own: Floats, k: int, state: Integers, weight: Floats, lost: Floats, center: Floats, radius: Floats, spread: Floats
) -> None:
    """The enclosure of the gradient: backward, with one generator for each open kink.

    `weight` has a row for every kink: the center of the function's derivative by it, and its generators; `lost` their
    radius.
    """
    weight[: k + 1, : k + 1] = 0.0
    lost[: k + 1] = 0.0
    weight[k, 0] = 1.0
    for i in range(k, -1, -1):
        row = weight[i]
        if i < k:
            if state[i] < 0:
                continue
            if state[i] == 0:
                reach = lost[i]
                for m in range(k + 1):
                    reach += abs(row[m])
                    row[m] *= 0.5
                row[1 + i] = 0.5 * reach * _UP
                lost[i] *= 0.5
        total = lost[i]
        for m in range(k + 1):
            total += abs(row[m])
        total *= _UP
        value = own[i]
        for axis in range(3):
            factor = value[1 + axis]
            center[axis] += factor * row[0]
            for m in range(i, k):
                spread[m, axis] += factor * row[1 + m]
            radius[axis] += abs(factor) * lost[i] + total * (value[4] + (k + 16) * _STEP * abs(factor))
        for j in range(i):
            factor = value[_BASE + j]
            if state[j] >= 0 and (factor != 0 or value[4] != 0):
                weight[j, 0] += factor * row[0]
                for m in range(i, k):
                    weight[j, 1 + m] += factor * row[1 + m]
                lost[j] += abs(factor) * lost[i] + total * (value[4] + (k + 16) * _STEP * abs(factor))
    for axis in range(3):
        radius[axis] = radius[axis] * _UP + _TINY


@compiled
def _at_point(own: Floats, k: int, at: Floats, found: Floats, error: Floats) -> tuple[float, float]:
    """The function at a point, and a bound of the error."""
    for i in range(k + 1):
        value = own[i]
        result = value[0] + value[1] * at[0] + value[2] * at[1] + value[3] * at[2]
        total = abs(value[0]) + abs(value[1]) + abs(value[2]) + abs(value[3])
        off = value[4]
        for j in range(i):
            factor = value[_BASE + j]
            result += factor * found[j]
            total += abs(factor * found[j])
            off += abs(factor) * error[j]
        error[i] = (off + (k + 16) * _STEP * total) * _UP + _TINY
        found[i] = result if i == k else max(result, 0.0)
    return found[k], error[k]


@compiled
def _restrict(rows: Floats, count: Integers, network: Integers, state: Integers, made: Floats) -> None:
    most = rows.shape[1]
    known, total = np.zeros((most, made.shape[2])), np.zeros(most)
    place = np.zeros(most, np.int64)
    for box in range(len(network)):
        own, k = rows[network[box]], count[network[box]]
        n_open = 0
        for i in range(k + 1):
            is_last = i == k
            if not is_last and state[box, i] < 0:
                continue
            row, value = known[i], own[i]
            row[:] = 0.0
            row[:_BASE] = value[:_BASE]
            size, largest, rest = abs(value[0]) + abs(value[1]) + abs(value[2]) + abs(value[3]), 1.0, 0.0
            for j in range(i):
                factor = value[_BASE + j]
                if state[box, j] == 0:
                    row[_BASE + place[j]] += factor
                    size += abs(factor)
                elif state[box, j] > 0:
                    for m in range(made.shape[2]):
                        if m != 4:
                            row[m] += factor * known[j, m]
                    size += abs(factor) * total[j]
                    rest += (abs(factor) + value[4]) * known[j, 4]
                    largest = max(largest, total[j])
            total[i] = size * _UP
            row[4] = (value[4] * largest + rest + (k + 16) * _STEP * size) * _UP + _TINY
            if is_last or state[box, i] == 0:
                made[box, n_open] = row
                place[i] = n_open
                n_open += 1
