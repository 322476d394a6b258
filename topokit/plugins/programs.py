"""Files that are programs: they are opened only if the caller names the file itself, and the adapter that runs it."""

from __future__ import annotations

from collections.abc import Sequence

from topokit.errors import InputError, Option
from topokit.plugins.adapter import Adapter


def not_asked_for(adapters: Sequence[Adapter], lead: str) -> InputError:
    """The error about a file that only adapters with `runs_code` would open, none of which was named.

    Args:
        adapters: those adapters.
        lead: beginning of a sentence that ends in what they are.
    """
    kinds = " and ".join(f"{adapter.name!r} ({adapter.description})" for adapter in adapters)
    advice = " ".join(dict.fromkeys(adapter.runs_code for adapter in adapters if adapter.runs_code))
    return InputError(
        f"{lead} {kinds}. Such a file is a program: opening it runs it, and it can do what you can do. So it is opened "
        "only on request: if you would run it, pass ",
        *alternatives([repr(adapter.name) for adapter in adapters]),
        f", with the path of this one file. {advice}",
    )


def alternatives(names: Sequence[str]) -> list[str | Option]:
    """The option `adapter` with each of several names, which are written as in Python, as parts of an error."""
    parts = [part for name in names for part in (" or ", Option("adapter", name))]
    return parts[1:]


def not_named(source: object, name: str) -> str:
    """The sentence about what is in a folder, matches a pattern or is at an address, for an adapter that runs code."""
    return (
        f"{source}: adapter {name!r} runs what it opens, since such files are programs. So it opens only files that "
        "are named one by one: none of a folder, of a pattern, or at an address. Give the path of the file."
    )
