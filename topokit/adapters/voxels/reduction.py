"""Work on all blocks of a stored volume and the joining of its results, here or on the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from topokit.adapters.voxels.stored import StoredVolume
from topokit.core.blocks.division import Box, Division

Found = TypeVar("Found")

_RETRIES = 2  # of the work on a block that failed; a worker that dies costs others, which `distributed` counts itself


def reduced(
    volume: StoredVolume,
    division: Division,
    count: Callable[[Any, Box], Found],
    join: Callable[[Found, Found, int], Found],
    client: Any,
    finish: Callable[[Found], Found],
) -> Found:
    """What is found in all blocks of a volume.

    Args:
        volume: where its values are.
        division: its blocks.
        count: what is found in a block, given by its values, or a function that reads them, and its place.
        join: joins what was found in two boxes side by side along an axis.
        client: of a Dask cluster; None for this process, one block after the other.
        finish: makes of what was found in the whole volume what is wanted of it.
    """
    if client is None:
        return finish(division.reduce(lambda box: count(volume.at(box), box), join))
    from dask import delayed

    work, joining = delayed(count, pure=False), delayed(join, pure=False)
    whole = division.reduce(lambda box: work(volume.at(box), box), joining)
    found: Found = client.compute(delayed(finish, pure=False)(whole), retries=_RETRIES).result()
    return found
