"""Work on all blocks of a volume or cloud, here or on the workers of a Dask cluster, and on those that fail again."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar

from topokit.core.blocks.division import Box, Division

Found = TypeVar("Found")
Task = TypeVar("Task")
Result = TypeVar("Result")

RETRIES = 2  # of the work on a block that failed; a worker that dies costs others, which `distributed` counts itself


def reduced(
    division: Division,
    source: Callable[[Box], Any],
    count: Callable[[Any, Box], Found],
    join: Callable[[Found, Found, int], Found],
    client: Any,
    finish: Callable[[Found], Found],
) -> Found:
    """What is found in all blocks of a volume.

    Args:
        division: its blocks.
        source: what `count` is given of a block.
        count: what is found in a block, given by that and its place; it may be large, as it is sent once.
        join: joins what was found in two boxes side by side along an axis.
        client: of a Dask cluster; None for this process, one block after the other.
        finish: makes of what was found in the whole volume what is wanted of it.
    """
    if client is None:
        return finish(division.reduce(lambda box: count(source(box), box), join))
    from dask import delayed

    call, joining = _sent_once(count), delayed(join, pure=False)
    whole = division.reduce(lambda box: call(source(box), box), joining)
    found: Found = client.compute(delayed(finish, pure=False)(whole), retries=RETRIES).result()
    return found


def mapped(work: Callable[[Task], Result], tasks: Sequence[Task], client: Any) -> Iterator[Result]:
    """The result of each task, in order.

    Args:
        work: picklable; it may be large, as it is sent once to each worker.
        tasks: what to call it with, one at a time.
        client: of a Dask cluster; None for this process, one task after the other.
    """
    if client is None:
        yield from map(work, tasks)
        return
    call = _sent_once(work)
    for future in client.compute([call(task) for task in tasks], retries=RETRIES):
        yield future.result()


def joined_on_cluster(
    work: Callable[[Task], Result], tasks: Sequence[Task], join: Callable[[Sequence[Result]], Result], client: Any
) -> Result:
    """The results of all tasks as one.

    Args:
        work: picklable; it may be large, as it is sent once to each worker.
        tasks: what to call it with, at least one.
        join: joins results, at most two at a time, in the order of their tasks.
        client: of a Dask cluster.
    """
    from dask import delayed

    call, joining = _sent_once(work), delayed(join, pure=False)
    parts: list[Any] = [call(task) for task in tasks]
    while len(parts) > 1:
        parts = [joining(parts[at : at + 2]) for at in range(0, len(parts), 2)]
    whole: Result = client.compute(parts[0], retries=RETRIES).result()
    return whole


def active_client() -> Any:
    """The client of a Dask cluster that this process works with; None if there is none, or on a worker.

    What waits on a worker for other work of its cluster may wait forever.
    """
    distributed = sys.modules.get("distributed")
    if distributed is None:
        return None
    try:
        distributed.get_worker()
    except ValueError:
        with suppress(ValueError):
            return distributed.default_client()
    return None


def _sent_once(work: Callable[..., Any]) -> Callable[..., Any]:
    """Makes of a task its result on a worker, later; the work, which may be large, is sent once."""
    from dask import delayed

    return partial(delayed(_called, pure=False), delayed(work, traverse=False))


def _called(work: Callable[..., Result], *task: Any) -> Result:
    return work(*task)
