"""The errors topokit raises: each says what came, what was expected and what to do."""

from __future__ import annotations


class TopokitError(Exception):
    """Base class of every error that topokit raises on purpose."""


class InputError(TopokitError, ValueError):
    """The data given cannot be used: wrong shape, wrong type, too few points, not finite."""


class NoSamplesError(InputError):
    """The shape has a report, but no samples: its volume is counted block by block and never held as a whole."""


class ReadError(TopokitError, OSError):
    """A file is missing, unreadable, truncated or not what its content claims to be."""


class UnknownFormatError(TopokitError, ValueError):
    """Neither content nor suffix names a format that topokit knows."""


class MissingDependencyError(TopokitError, ImportError):
    """An optional package is needed; the message holds the line that installs it."""


class AdapterError(TopokitError, RuntimeError):
    """An adapter broke its promise: it could not be imported, failed while opening, or returned what is no `Shape`."""


class AdapterWarning(UserWarning):
    """A plug-in is broken; it is left out, and everything else works."""


class GenusError(TopokitError, ValueError):
    """The genus is undefined (the surface is not a manifold or not orientable) or unknown."""


def summary(error: BaseException | None) -> str:
    """An exception's class and what it says, in one short line."""
    said = " ".join(str(error).split())[:200] or "no message"
    return f"{type(error).__name__}: {said}"
