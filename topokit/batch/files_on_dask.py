"""Whole files examined by the workers of a Dask cluster; a worker that dies costs a retry, not a result."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar

from topokit.core.processors import n_cores
from topokit.errors import InputError, requiring, summary

Task = TypeVar("Task")
Result = TypeVar("Result")

LOCAL = "local"  # instead of an address: processes of this machine
_AHEAD = 1024  # tasks sent before the first result is back: enough for some hundred workers


def map_on_cluster(
    function: Callable[[Task], Result], tasks: Iterable[Task], client: Any, after_death: Callable[[Task, str], Result]
) -> Generator[tuple[int, Result]]:
    """The results of a function with the numbers of their tasks, as they are known.

    A task whose worker died is tried again by others, as often as the scheduler allows. It then may be at fault, or one
    that was waiting on the same worker: so it is tried once more alone, after all others, before it is given up.

    Args:
        function: of a module that workers can import; the result must be picklable, too.
        tasks: what to call it with, one at a time.
        client: a `dask.distributed.Client`.
        after_death: gives, for a task that ends its workers and the reason, the result in its place.
    """
    from dask.distributed import KilledWorker, as_completed

    left = enumerate(tasks)
    pending: dict[str, tuple[int, Task]] = {}
    coming = as_completed(loop=client.loop)

    def send(number: int, task: Task) -> None:
        future = client.submit(function, task, pure=False)
        pending[future.key] = number, task
        coming.add(future)

    suspects: list[tuple[int, Task]] = []
    for number, task in islice(left, _AHEAD):
        send(number, task)
    for future in coming:
        number, task = pending.pop(future.key)
        for following in islice(left, 1):
            send(*following)
        if future.status == "error" and isinstance(future.exception(), KilledWorker):
            suspects.append((number, task))
        else:
            yield number, future.result()
    for number, task in suspects:
        future = client.submit(function, task, pure=False)
        error = future.exception()  # waits
        if isinstance(error, KilledWorker):
            yield number, after_death(task, "the workers of the cluster that examined it died, one after the other")
        else:
            yield number, future.result()


@contextmanager
def connected(address: str, n_workers: int = 0) -> Iterator[Any]:
    """A client of a cluster during the block.

    Args:
        address: of its scheduler, as "tcp://host:8786"; or "local" for processes of this machine, which end with the
            block.
        n_workers: how many of these; 0 is one for each core.

    Raises:
        MissingDependencyError: if Dask is not installed.
        InputError: if there is no scheduler at the address.
    """
    with requiring('A cluster needs Dask: pip install "topokit[cluster]".'):
        from dask.distributed import Client, LocalCluster
    if address == LOCAL:
        options = {"n_workers": n_workers or n_cores(), "threads_per_worker": 1, "dashboard_address": ":0"}
        with LocalCluster(silence_logs=logging.CRITICAL, **options) as cluster, Client(cluster) as client:
            yield client
        return
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        raise InputError(
            f"no scheduler answers at {address!r} ({summary(error)}); expected an address as tcp://host:8786, or local."
        ) from error
    with client:
        yield client
