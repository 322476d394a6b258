"""The errors topokit raises: each says what came, what was expected and what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True)
class Option:
    """An option that a message names, in the words of Python; the command line has words of its own.

    Attributes:
        name: of the parameter.
        value: as Python writes it, "…" for any, or None for the name alone.
        written: what Python calls it, where that is not name=value: a function for a kind of files, for example.
    """

    name: str
    value: str | None = None
    written: str | None = None

    def __str__(self) -> str:
        return self.written or (self.name if self.value is None else f"{self.name}={self.value}")


class TopokitError(Exception):
    """Base class of every error that topokit raises on purpose.

    Attributes:
        parts: the message, as texts and the options that it names.
        file: the one that the message names, for errors that are not about files alone; else None.
    """

    def __init__(self, *parts: str | Option, file: object = None) -> None:
        super().__init__("".join(map(str, parts)))
        self.parts, self.file = parts, file

    def rename(self, before: str, after: str) -> None:
        """Call a file by another name: a temporary copy, for example, by that of the original."""
        self.parts = tuple(part.replace(before, after) if isinstance(part, str) else part for part in self.parts)
        self.args = ("".join(map(str, self.parts)),)

    def worded(self, option: Callable[[Option], str]) -> str:
        """The message with other words for options."""
        return "".join(part if isinstance(part, str) else option(part) for part in self.parts)


class InputError(TopokitError, ValueError):
    """The data given cannot be used: wrong shape, wrong type, too few points, not finite."""


class NoSamplesError(InputError):
    """The shape has a report, but no samples: its volume is counted block by block and never held as a whole."""


class Interrupted(KeyboardInterrupt):
    """An interrupt of work of which a part was done.

    Attributes:
        shape: what it came to: a `Shape` that was counted, which the same call goes on with.
    """

    def __init__(self, shape: object) -> None:
        super().__init__("interrupted; what was done is in the exception's shape")
        self.shape = shape


class ReadError(TopokitError, OSError):
    """A file is missing, unreadable, truncated or not what its content claims to be."""


class UnknownFormatError(TopokitError, ValueError):
    """Neither content nor suffix names a format that topokit knows."""


class MissingDependencyError(TopokitError, ImportError):
    """An optional package is needed; the message holds the line that installs it."""


@contextmanager
def requiring(message: str) -> Iterator[None]:
    """Raise an ImportError of the block as a `MissingDependencyError`.

    Args:
        message: what needs which package, and how to install it.
    """
    try:
        yield
    except ImportError as error:
        raise MissingDependencyError(message) from error


class AdapterError(TopokitError, RuntimeError):
    """An adapter broke its promise: it could not be imported, failed while opening, or returned what is no `Shape`."""


class AdapterWarning(UserWarning):
    """A plug-in is broken; it is left out, and everything else works."""


class GenusError(TopokitError, ValueError):
    """The genus is undefined (the surface is not a manifold or not orientable) or unknown."""


FOR_POINTS = Option("adapter", "'points'", "topokit.from_points")
FOR_MESHES = Option("adapter", "'mesh'", "topokit.from_mesh")
"""What opens such files instead."""


def summary(error: BaseException | None) -> str:
    """An exception's class and what it says, in one short line."""
    said = " ".join(str(error).split())[:200] or "no message"
    return f"{type(error).__name__}: {said}"
