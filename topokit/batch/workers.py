"""Who examines files: this process, others on this machine, or the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from topokit.batch.examine import Answer, Options, Questions, examine, failure
from topokit.batch.limits import NO_LIMITS, Limits
from topokit.batch.own_process import call_in_own_process
from topokit.batch.processes import map_in_processes
from topokit.batch.sources import Source
from topokit.core.processors import n_cores
from topokit.errors import TopokitError
from topokit.inputs.remote import is_zarr_address

Item = TypeVar("Item")

_LARGE = (  # what several workers may share
    *(".zarr", ".h5", ".hdf5", ".npy"),  # files, or folders, that may hold a volume to be counted block by block
    *(".las", ".laz", ".parquet", ".ply", ".xyz", ".txt", ".csv", ".pwn", ".pts", ".asc"),  # or a cloud
    *(".pt", ".pth", ".pt2", ".ts"),  # or a network
)
_NETWORKS = ("sdf", "occupancy")
_FINE = 1024  # cells of a network's finest grid from which on all workers share it


def examine_each(
    sources: Sequence[Source], questions: Questions, jobs: int, limits: Limits = NO_LIMITS, client: Any = None
) -> Generator[tuple[int, list[Answer]]]:
    """The answers about each source with its number, as they are known: in order if this process examines them.

    Args:
        sources: files.
        questions: what to ask.
        jobs: number of processes; 1 stays in this one unless there are limits, 0 is one for each core.
        limits: on each file.
        client: a `dask.distributed.Client`, whose workers examine the files instead; or None.
    """
    ask: Callable[[Source], list[Answer]] = partial(examine, questions=questions)
    jobs = jobs or n_cores()
    if client is not None:
        yield from _on_cluster(sources, questions, limits, client)
    elif (jobs == 1 and not limits) or not sources:
        yield from enumerate(map(ask, sources))
    else:
        with closing(map_in_processes(ask, sources, min(jobs, len(sources)), _after_death, limits)) as coming:
            yield from coming


def in_order(coming: Iterable[tuple[int, Item]]) -> Iterator[tuple[int, Item]]:
    """Numbered items in the order of their numbers 0, 1, 2, …: those that come early are held back."""
    early: dict[int, Item] = {}
    following = 0
    for number, item in coming:
        early[number] = item
        while following in early:
            yield following, early.pop(following)
            following += 1


@dataclass(frozen=True)
class _WithClient:
    """The options of a volume or cloud whose blocks are read by a cluster."""

    options: Options
    client: Any

    def __call__(self, path: Path | str) -> tuple[str, Mapping[str, Any]]:
        """The adapter's name and its options."""
        adapter, options = self.options(path)
        return adapter, {**options, "client": self.client}


def _on_cluster(
    sources: Sequence[Source], questions: Questions, limits: Limits, client: Any
) -> Generator[tuple[int, list[Answer]]]:
    """The answers of a cluster: each file by one worker, then each large volume or cloud by all of them.

    With limits every file is examined by one worker, in a process of its own.
    """
    from topokit.batch.cluster import map_on_cluster

    found = [_from_anywhere(source) for source in sources]
    large = [number for number, source in enumerate(found) if not limits and _is_large(source, questions)]
    others = [number for number in range(len(found)) if number not in set(large)]
    ask: Callable[[Source], list[Answer]] = partial(examine, questions=questions)
    ask = partial(call_in_own_process, ask, after_death=_after_death, limits=limits) if limits else ask
    with closing(map_on_cluster(ask, [found[number] for number in others], client, _after_death)) as coming:
        for place, answers in coming:
            yield others[place], answers
    by_all = replace(questions, options=_WithClient(questions.options, client))
    for number in large:
        yield number, examine(found[number], by_all)


def _is_large(source: Source, questions: Questions) -> bool:
    """Whether a file is a volume or cloud that is read block by block, or a network on a grid as large."""
    if source.problem is not None or not _may_be_large(source.path):
        return False
    from topokit.adapters.points.large import stored_cloud
    from topokit.adapters.voxels.large import blocks_of

    try:
        adapter, options = questions.options(source.path)
        if adapter == "points":
            return stored_cloud(source.path, options.get("block_points"), None) is not None
        if adapter in _NETWORKS:
            return int(options.get("resolution") or 0) >= _FINE
        if adapter != "voxels":
            return False
        return blocks_of(source.path, options.get("dataset"), options.get("block_voxels"), None) is not None
    except TopokitError:  # its answer says so
        return False


def _may_be_large(place: Path | str) -> bool:
    if isinstance(place, str):
        return is_zarr_address(place)
    return place.is_dir() or place.suffix.lower() in _LARGE


def _from_anywhere(source: Source) -> Source:
    """The source with an absolute path: workers may be in other folders."""
    return source if isinstance(source.path, str) else replace(source, path=source.path.absolute())


def _after_death(source: Source, how: str) -> list[Answer]:
    return [failure(source, f"{source.name}: {how}.", None)]
