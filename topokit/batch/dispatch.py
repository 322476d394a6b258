"""Who examines files: this process, others on this machine, or the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from topokit.batch.examine import Answer, Questions, examine, failure
from topokit.batch.limits import NO_LIMITS, Limits
from topokit.batch.processes import call_in_own_process, map_in_processes
from topokit.batch.sources import Source
from topokit.core.processors import n_cores
from topokit.core.progress import ignore, listening
from topokit.errors import TopokitError
from topokit.plugins.registry import list_adapters, opens_address, shared_by_workers
from topokit.plugins.sending import know_adapters, packed_adapters

Item = TypeVar("Item")


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
    if client is not None:
        yield from _on_cluster(sources, questions, limits, client)
    else:
        yield from ask_each(partial(examine, questions=questions), sources, jobs, _after_death, limits)


def ask_each(
    ask: Callable[[Source], Item],
    sources: Sequence[Source],
    jobs: int,
    after_death: Callable[[Source, str], Item],
    limits: Limits = NO_LIMITS,
) -> Generator[tuple[int, Item]]:
    """What is asked of each source, with its number, as it is known: in order if this process does it.

    Args:
        ask: function of a module, so that other processes can import it.
        sources: files.
        jobs: as for `examine_each`.
        after_death: gives, for the source whose process died and the reason, the answer in its place.
        limits: on each file.
    """
    jobs = jobs or n_cores()
    if (jobs == 1 and not limits) or not sources:
        yield from enumerate(map(ask, sources))
        return
    with closing(map_in_processes(_elsewhere(ask), sources, min(jobs, len(sources)), after_death, limits)) as coming:
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


def _on_cluster(
    sources: Sequence[Source], questions: Questions, limits: Limits, client: Any
) -> Generator[tuple[int, list[Answer]]]:
    """The answers of a cluster: each file by one worker, then each large one by all of them.

    With limits every file is examined by one worker, in a process of its own.
    """
    from topokit.batch.files_on_dask import map_on_cluster

    found = [_from_anywhere(source) for source in sources]
    large = [number for number, source in enumerate(found) if not limits and _is_large(source, questions)]
    others = [number for number in range(len(found)) if number not in set(large)]
    ask = _elsewhere(partial(examine, questions=questions))
    ask = partial(call_in_own_process, ask, after_death=_after_death, limits=limits) if limits else ask
    with closing(map_on_cluster(ask, [found[number] for number in others], client, _after_death)) as coming:
        for place, answers in coming:
            yield others[place], answers
    by_all = replace(questions, client=client)
    for number in large:
        yield number, examine(found[number], by_all)


def _elsewhere(ask: Callable[[Source], Item]) -> Callable[[Source], Item]:
    """The question for a process that is not this one, with the adapters that were registered here."""
    return partial(_ask_here, ask, packed_adapters())


def _ask_here(ask: Callable[[Source], Item], adapters: bytes, source: Source) -> Item:
    """What another process asks of a source; the bars of many workers would overlap."""
    know_adapters(adapters)
    with listening(ignore):
        return ask(source)


def _is_large(source: Source, questions: Questions) -> bool:
    """Whether several workers should share a file."""
    if source.problem is not None or not _may_be_large(source.path):
        return False
    try:
        return shared_by_workers(source.path, *questions.options(source.path))
    except TopokitError:  # its answer says so
        return False


def _may_be_large(place: Path | str) -> bool:
    """Whether an adapter that has large files may open one, by its name alone: thousands of others are not opened."""
    if isinstance(place, str):
        return opens_address(place)
    suffixes = tuple(suffix for one in list_adapters() if one.is_large is not None for suffix in one.suffixes)
    return place.is_dir() or place.name.lower().endswith(suffixes)


def _from_anywhere(source: Source) -> Source:
    """The source with an absolute path: workers may be in other folders."""
    return source if isinstance(source.path, str) else replace(source, path=source.path.absolute())


def _after_death(source: Source, how: str) -> list[Answer]:
    return [failure(source, f"{source.name}: {how}.", None)]
