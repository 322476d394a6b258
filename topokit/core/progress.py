"""How far a long computation is: it names its stages, and a listener gets the share that is done.

The computation announces `stages`, says when one of them begins, and may `advance` within it. `listening`
sets what is called with that in a block and thread; by default nothing is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

Listener = Callable[[str, float], None]
"""Called with the stage and the share of the whole that is done, from 0 to 1; the share never falls."""


@dataclass
class _Course:
    """Announced stages with their weights, the stage that goes on, and the shares done before it and so far."""

    weights: Mapping[str, float]
    stage: str = ""
    before: float = 0.0
    done: float = 0.0

    def weight(self, *stages: str) -> float:
        """Share of the whole that some stages are; 0 for those that were not announced."""
        return sum(self.weights.get(stage, 0.0) for stage in stages) / sum(self.weights.values())


_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_course: ContextVar[_Course | None] = ContextVar("course", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call a listener with the stages that begin in this block and thread."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def has_listener() -> bool:
    """Whether there is a listener here."""
    return _listener.get() is not None


def ignore(stage: str, share: float) -> None:
    """A `Listener` that shows nothing, and keeps others from it."""


@contextmanager
def stages(weights: Mapping[str, float]) -> Iterator[None]:
    """The stages of the block in their order, with the time that each takes in any unit.

    Stages may be skipped. A block in a block reports nothing: it is a part of a stage.
    """
    token = _course.set(_Course({} if _course.get() is not None else weights))
    try:
        yield
    finally:
        _course.reset(token)


def begin(stage: str) -> None:
    """A stage begins, and those before it are done."""
    course = _course.get()
    if course is None or not course.weights or stage == course.stage:
        return
    names = list(course.weights)
    earlier = names[: names.index(stage)] if stage in course.weights else ()
    course.stage, course.before = stage, max(course.done, course.weight(*earlier))
    advance(0.0)


def advance(share: float) -> None:
    """This share of the stage that goes on is done."""
    course, listener = _course.get(), _listener.get()
    if course is None or not course.weights:
        return
    course.done = max(course.done, course.before + share * course.weight(course.stage))
    if listener is not None:
        listener(course.stage, course.done)
