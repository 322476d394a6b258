"""Euler characteristic as an integral of curvature (paper, Section II-C)."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def euler_characteristic(gaussian: Tensor, areas: Tensor) -> Tensor:
    """χ⁽⁰⁾ = (1/2π) Σ Kᵢ Aᵢ over the last axis.

    For a closed surface this tends to V − E + F. For a surface with boundary it lacks the boundary's turning.

    Args:
        gaussian: K, (..., N).
        areas: A, (..., N).

    Returns:
        (...,), differentiable.

    Reference:
        Paper, equations `gaussbonnet` and `euler`.
    """
    return (gaussian * areas).sum(-1) / (2 * math.pi)


def euler_by_component(gaussian: Tensor, areas: Tensor, labels: Tensor) -> Tensor:
    """χ⁽⁰⁾ of every connected component.

    Args:
        gaussian: K, (N,).
        areas: A, (N,).
        labels: (N,) int64 component labels 0 … c−1, as `neighbor_components` gives them.

    Returns:
        (c,), differentiable; its sum is `euler_characteristic`.
    """
    n_components = int(labels.max()) + 1
    total = torch.zeros(n_components, dtype=gaussian.dtype, device=gaussian.device)
    return total.index_add(0, labels, gaussian * areas) / (2 * math.pi)
