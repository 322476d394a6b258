"""Who examines files: this process, others on this machine, or the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import Any

from topokit.batch.examine import Answer, Questions, examine, failure
from topokit.batch.limits import NO_LIMITS, Limits
from topokit.batch.processes import map_in_processes, n_cores
from topokit.batch.sources import Source
from topokit.errors import InputError


def examine_each(
    sources: Sequence[Source], questions: Questions, jobs: int, limits: Limits = NO_LIMITS, client: Any = None
) -> Generator[tuple[int, list[Answer]]]:
    """The answers about each source with its number, as they come: in order, but those of a cluster as they are known.

    Args:
        sources: files.
        questions: what to ask.
        jobs: number of processes; 1 stays in this one unless there are limits, 0 is one for each core.
        limits: on each file.
        client: a `dask.distributed.Client`, whose workers examine the files instead; or None.

    Raises:
        InputError: if there are limits and a client.
    """
    ask: Callable[[Source], list[Answer]] = partial(examine, questions=questions)
    jobs = jobs or n_cores()
    if client is not None:
        from topokit.batch.cluster import map_on_cluster

        if limits:
            raise InputError("limits on time and memory are for processes of this machine; a cluster has its own.")
        found = [replace(source, path=source.path.absolute()) for source in sources]  # workers may be in other folders
        with closing(map_on_cluster(ask, found, client, _after_death)) as coming:
            yield from coming
    elif (jobs == 1 and not limits) or not sources:
        yield from enumerate(map(ask, sources))
    else:
        with closing(map_in_processes(ask, sources, min(jobs, len(sources)), _after_death, limits)) as answers:
            yield from enumerate(answers)


def _after_death(source: Source, how: str) -> list[Answer]:
    return [failure(source, f"{source.name}: {how}.", None)]
