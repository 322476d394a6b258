"""The least optical depth at which a place is seen from outside, along any path; differentiable in the extinction.

A place is hidden if light is absorbed on every way to it. Paths may bend, so what lies in a deep hole is seen if
nothing opaque is before it, as in a flood that stops at walls, whose strength adds up.
"""

from __future__ import annotations

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
_SOURCE = -1  # in the table of predecessors: the path begins here


def least_depth(extinction: Tensor, cell: float) -> Tensor:
    """The optical depth of the clearest path from outside the grid to each vertex; steps go to 26 neighbors.

    Args:
        extinction: (X, Y, Z) float64 on the CPU, not negative, in 1 / length. Its outermost layer counts as air.
        cell: step of the grid, in units of length.

    Returns:
        (X, Y, Z) float64, 0 in the air around; differentiable in the extinction at fixed paths.
    """
    depth: Tensor = _LeastDepth.apply(extinction, cell)
    return depth


class _LeastDepth(torch.autograd.Function):
    @staticmethod
    def forward(context: Any, extinction: Tensor, cell: float) -> Tensor:
        from skimage.graph import MCP_Geometric

        steps = _within(extinction.detach().numpy() * cell)
        air = _air(steps)
        search = MCP_Geometric(np.where(air, -1.0, steps), fully_connected=True)  # negative: no path leads there
        starts = np.argwhere(ndimage.binary_dilation(air, np.ones((3, 3, 3))) & ~air)
        if len(starts):
            depth, before = search.find_costs(starts)
        else:
            depth, before = np.zeros(air.shape), np.full(air.shape, _SOURCE)
        context.found = before, np.asarray(search.offsets, dtype=np.int64), cell
        depth[air] = 0
        context.save_for_backward(torch.from_numpy(depth))
        return torch.from_numpy(depth)

    @staticmethod
    @once_differentiable
    def backward(context: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
        before, offsets, cell = context.found
        [depth] = context.saved_tensors
        order = np.argsort(-depth.numpy(), axis=None)[: int((depth > 0).sum())]  # the end of each path first
        flow = slope.numpy().copy().reshape(-1)
        strides = np.array([depth.shape[1] * depth.shape[2], depth.shape[2], 1])
        lengths = np.linalg.norm(offsets, axis=1) * cell
        found = _flow_back(order, before.reshape(-1), offsets @ strides, lengths, flow)
        return torch.from_numpy(_within(found.reshape(depth.shape))), None


def _within(values: Floats) -> Floats:
    """The values with zeros in the outermost layer."""
    return np.pad(values[1:-1, 1:-1, 1:-1], 1)


def _air(steps: Floats) -> Booleans:
    """What is joined with the first vertex through places without extinction."""
    labels = ndimage.label(steps < _CLEAR / sum(steps.shape))[0]
    found: Booleans = labels == labels[0, 0, 0]
    return found


@compiled
def _flow_back(order: Integers, before: NDArray[np.int32], strides: Integers, lengths: Floats, flow: Floats) -> Floats:
    """Slopes by the extinction at each vertex: half a step's length for all paths that pass through it."""
    found = np.zeros(len(flow))
    for vertex in order:
        offset = before[vertex]
        if flow[vertex] == 0 or offset < 0:
            continue
        previous = vertex - strides[offset]
        half = flow[vertex] * lengths[offset] / 2
        found[vertex] += half
        found[previous] += half
        flow[previous] += flow[vertex]
    return found
