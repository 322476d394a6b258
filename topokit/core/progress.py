"""How far a long computation is: stages of known weight, told to whoever listens."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[str, float], None]
"""Told the name of each stage as it begins, and the share of the whole that is done by then, from 0 to 1."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_weights: ContextVar[Mapping[str, float] | None] = ContextVar("weights", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Tell a listener of the stages that begin in this block and thread."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def stages(weights: Mapping[str, float]) -> Iterator[None]:
    """The stages of the block in their order, with the time that each takes in any unit.

    Stages may be skipped. A block in a block tells nothing: it is a part of a stage.
    """
    is_inner = _weights.get() is not None
    token = _weights.set({} if is_inner else weights)
    try:
        yield
    finally:
        _weights.reset(token)


def begin(stage: str) -> None:
    """A stage begins: its listener, if there is one, is told the share of the stages before it."""
    listener, weights = _listener.get(), _weights.get()
    if listener is None or not weights:
        return
    names = list(weights)
    before = sum(weights[name] for name in names[: names.index(stage)])
    listener(stage, before / sum(weights.values()))
