"""Batches of clouds of different size: nested tensors, or padded rows with the number of points of each cloud."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeGuard

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from topokit.core.residence import stays_on_device
from topokit.core.samples import is_padding
from topokit.errors import InputError


def is_nested(values: object) -> TypeGuard[Tensor]:
    """Whether this is a nested tensor of torch, of either layout."""
    return isinstance(values, Tensor) and values.is_nested


def padded(values: Tensor, name: str) -> tuple[Tensor, list[int]]:
    """A nested tensor as a batch (B, N, 3) with its graph, zeros behind each cloud, and the number of rows of each.

    The host reads the lengths, which decide the shape of the result.

    Raises:
        InputError: if the nested tensor is empty, or does not consist of lists of points (Nᵢ, 3).
    """
    clouds = values.unbind()
    if not clouds or any(cloud.ndim != 2 or cloud.shape[1] != 3 for cloud in clouds):
        shapes = ", ".join(str(tuple(cloud.shape)) for cloud in clouds[:3])
        raise InputError(
            f"a nested tensor of {name} must consist of clouds (Nᵢ, 3), got {len(clouds)} items of shapes [{shapes}"
            f"{', …' if len(clouds) > 3 else ''}]."
        )
    return pad_sequence(list(clouds), batch_first=True), [len(cloud) for cloud in clouds]


def checked_lengths(lengths: Tensor | Sequence[int], points: Tensor, least: int) -> Tensor:
    """The lengths on the points' device, where they are not looked at; only those that come from the host are.

    Args:
        lengths: (...) number of points of each cloud.
        points: (..., N, 3), padded.
        least: fewest points that a cloud may have.

    Raises:
        InputError: if they are no integers of that shape, too small or too large.
    """
    given = torch.as_tensor(lengths)
    if given.is_floating_point() or given.is_complex() or given.dtype == torch.bool:
        raise InputError(f"lengths must be integers, the number of points of each cloud; got {given.dtype}.")
    if given.shape != points.shape[:-2]:
        raise InputError(
            f"lengths must have the shape {tuple(points.shape[:-2])}, one number for each cloud; got the shape "
            f"{tuple(given.shape)}."
        )
    most = points.shape[-2]
    is_on_host = not (isinstance(lengths, Tensor) and stays_on_device(given))
    if is_on_host and not bool(((given >= least) & (given <= most)).all()):
        raise InputError(
            f"lengths must lie between {least}, one more than the neighbors of each point, and {most}, the rows of the "
            f"batch; got {given.tolist()}."
        )
    return given.to(points.device, torch.int64)


def without_padding(points: Tensor, normals: Tensor | None, lengths: Tensor) -> tuple[Tensor, Tensor | None]:
    """Points and normals with zeros in their padding, which may have held NaN."""
    padding = is_padding(lengths, points.shape[-2])[..., None]
    return points.masked_fill(padding, 0), None if normals is None else normals.masked_fill(padding, 0)
