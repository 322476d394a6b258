"""The least optical depth at which a place is seen from outside, along any path; differentiable in the extinction.

A place is hidden if light is absorbed on every way to it. Paths may bend, so what lies in a deep hole is seen if
nothing opaque is before it, as in a flood that stops at walls, whose strength adds up.
"""

from __future__ import annotations

import heapq
import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor
from torch.autograd.function import once_differentiable

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.compiled import compiled

_CLEAR = 1e-4  # optical depth on a way through the whole grid that is still called air
_OFFSETS = np.array([offset for offset in np.ndindex(3, 3, 3) if offset != (1, 1, 1)]) - 1  # to the 26 neighbors


def least_depth(extinction: Tensor, cell: float, most: float = math.inf) -> Tensor:
    """The optical depth of the clearest path from outside the grid to each vertex; steps go to 26 neighbors.

    Args:
        extinction: (X, Y, Z) float64 on the CPU, not negative, in 1 / length. Its outermost layer counts as air.
        cell: step of the grid, in units of length.
        most: depth from which paths are not followed; what lies deeper has this depth.

    Returns:
        (X, Y, Z) float64, 0 in the air around; differentiable in the extinction at fixed paths.
    """
    depth: Tensor = _LeastDepth.apply(extinction, cell, most)
    return depth


class _LeastDepth(torch.autograd.Function):
    @staticmethod
    def forward(context: Any, extinction: Tensor, cell: float, most: float) -> Tensor:
        steps = _within(extinction.detach().numpy() * cell)
        depth, before = np.full(steps.shape, most), np.full(steps.shape, -1, dtype=np.int8)
        air = _air(steps)
        depth[air] = 0
        _follow(steps.ravel(), air.ravel(), *_strides(steps.shape), depth.reshape(-1), before.reshape(-1))
        found = torch.from_numpy(depth)
        context.save_for_backward(found)
        context.paths = before, cell
        return found

    @staticmethod
    @once_differentiable
    def backward(context: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
        before, cell = context.paths
        [depth] = context.saved_tensors
        order = np.argsort(-depth.numpy(), axis=None)[: int((depth > 0).sum())]  # the end of each path first
        flow = slope.numpy().copy().reshape(-1)
        found = _flow_back(order, before.reshape(-1), *_strides(depth.shape), flow) * cell
        return torch.from_numpy(_within(found.reshape(depth.shape))), None, None


def _within(values: Floats) -> Floats:
    """The values with zeros in the outermost layer."""
    return np.pad(values[1:-1, 1:-1, 1:-1], 1)


def _air(steps: Floats) -> Booleans:
    """What is joined with the first vertex through places without extinction."""
    labels = ndimage.label(steps < _CLEAR / sum(steps.shape))[0]
    found: Booleans = labels == labels[0, 0, 0]
    return found


def _strides(shape: tuple[int, ...]) -> tuple[Integers, Floats]:
    """To each of the 26 neighbors: the difference of flat indices, and the distance in cells."""
    return _OFFSETS @ np.array([shape[1] * shape[2], shape[2], 1]), np.linalg.norm(_OFFSETS, axis=1)


@compiled
def _follow(
    steps: Floats, air: Booleans, strides: Integers, lengths: Floats, depth: Floats, before: NDArray[np.int8]
) -> None:
    """Write the depths, and the neighbor from which each path comes, by the algorithm of Dijkstra.

    Args:
        steps: (N,) optical depth of a step in the cell around each vertex.
        air: (N,), the outermost layer with it: where paths begin, and none leads to.
        strides: (26,) to the neighbors.
        lengths: (26,) of the ways there, in cells.
        depth: (N,), to be lowered from the largest depth that matters; 0 in the air.
        before: (N,), −1.
    """
    paths = [(0.0, 0)]
    paths.pop()
    for vertex in range(len(steps)):
        if air[vertex]:
            continue
        for stride in strides:
            if air[vertex + stride]:
                depth[vertex] = 0.0
                paths.append((0.0, vertex))  # equal keys are a heap already
                break
    while paths:
        so_far, vertex = heapq.heappop(paths)
        if so_far > depth[vertex]:
            continue
        for number in range(len(strides)):
            other = vertex + strides[number]
            if air[other]:
                continue
            further = so_far + (steps[vertex] + steps[other]) / 2 * lengths[number]
            if further < depth[other]:
                depth[other] = further
                before[other] = number
                heapq.heappush(paths, (further, other))


@compiled
def _flow_back(order: Integers, before: NDArray[np.int8], strides: Integers, lengths: Floats, flow: Floats) -> Floats:
    """Slopes by the extinction at each vertex: half a step's length for all paths that pass through it."""
    found = np.zeros(len(flow))
    for vertex in order:
        number = before[vertex]
        if flow[vertex] == 0 or number < 0:
            continue
        previous = vertex - strides[number]
        half = flow[vertex] * lengths[number] / 2
        found[vertex] += half
        found[previous] += half
        flow[previous] += flow[vertex]
    return found
