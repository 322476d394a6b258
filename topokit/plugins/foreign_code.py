"""Where the code of others begins: it is found, imported and called here, and what goes wrong in it gets a name."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topokit.errors import AdapterError, AdapterWarning, InputError, MissingDependencyError, TopokitError, summary
from topokit.plugins.adapter import Adapter

if TYPE_CHECKING:
    from topokit.shape import Shape

GROUP = "topokit.adapters"
_warned: set[str] = set()


@contextmanager
def foreign_code(what_failed: str) -> Iterator[None]:
    """Whatever the block raises, as an `AdapterError` that begins with `what_failed`; errors of topokit's own pass.

    This is the one place of topokit that catches everything. A plug-in raises what it likes, exceptions of its own
    among it, which no list can name; and one that fails must not take the others with it. Nothing is lost: the
    exception is raised on, with its cause. SystemExit and KeyboardInterrupt pass.
    """
    try:
        yield
    except TopokitError:
        raise
    except Exception as error:
        raise AdapterError(f"{what_failed} ({summary(error)}).") from error


def warn_once(name: str, message: str) -> None:
    """One warning about a broken plug-in, however often it is met."""
    if name not in _warned:
        _warned.add(name)
        warnings.warn(message, AdapterWarning, stacklevel=2)


def entry_points() -> Iterator[tuple[str, str, str]]:
    """(name, "package.module:Class", distribution) of every installed plug-in, in a fixed order."""
    from importlib import metadata

    found = metadata.entry_points(group=GROUP)
    rows = {(one.name, one.value.partition("[")[0].strip(), str(one.dist.name) if one.dist else "?") for one in found}
    yield from sorted(rows)


def imported(target: str) -> object:
    """What "package.module:Class" names.

    Raises:
        AdapterError: if it cannot be imported.
    """
    if not _is_target(target):
        raise AdapterError(f"it is given as {target!r}; expected 'package.module:Class'.")
    module, _, attribute = target.partition(":")
    with foreign_code(f"{target} could not be imported"):
        return reduce(getattr, attribute.split("."), importlib.import_module(module))


def as_adapter(found: object, name: str) -> Adapter:
    """An adapter of what a plug-in gave, if it is one.

    Raises:
        AdapterError: if it is something else, lacks an attribute, or calls itself something else than `name`.
    """
    if not (isinstance(found, type) and issubclass(found, Adapter)) and not isinstance(found, Adapter):
        raise AdapterError(f"it is {_article(found)}; expected a subclass of topokit.Adapter.")
    with foreign_code("it cannot be made without arguments"):
        adapter = found() if isinstance(found, type) else found
    wrong = next(_faults(adapter, name), None)
    if wrong is not None:
        raise AdapterError(wrong)
    return adapter


def option_names(adapter: Adapter) -> frozenset[str] | None:
    """Options of an adapter; None if it takes any. Imports its opener.

    Raises:
        MissingDependencyError, AdapterError: if it cannot be imported.
    """
    with _calling(adapter, f"adapter {adapter.name!r} could not be asked for its options"):
        return adapter.options()


def opened(adapter: Adapter, source: Any, options: Mapping[str, Any]) -> Shape:
    """The shape an adapter makes, checked.

    `n_neighbors` belongs to the shape, so it need not be an option of the adapter; nor need the file's name.

    Raises:
        TopokitError: the adapter's own; about samples with the file's name.
        MissingDependencyError: if it lacks a package.
        AdapterError: if it raises anything else, or returns something else than a `Shape`.
    """
    from topokit.shape import UNNAMED, Shape

    what = f"adapter {adapter.name!r} could not open {_named(source)}"
    known = option_names(adapter)
    taken = {k: v for k, v in options.items() if k != "n_neighbors" or known is None or k in known}
    try:
        with _calling(adapter, what):
            shape = adapter.open(source, **taken)
    except InputError as error:
        if str(source) in str(error) or not isinstance(source, Path):
            raise
        raise InputError(f"{source} (adapter {adapter.name!r}): {error}") from error
    if not isinstance(shape, Shape):
        raise AdapterError(f"{what}: it returned {_article(shape)}; a topokit.Shape was expected.")
    if shape.name == UNNAMED and isinstance(source, Path):
        shape.name = source.name
    if "n_neighbors" in options:
        shape.n_neighbors = options["n_neighbors"]
    return shape


@contextmanager
def _calling(adapter: Adapter, what_failed: str) -> Iterator[None]:
    """`foreign_code` of an adapter, where an import that fails is a package to be installed."""
    try:
        with foreign_code(what_failed):
            yield
    except AdapterError as error:
        if not isinstance(error.__cause__, ImportError):
            raise
        how = f'pip install "{adapter.extra}"' if adapter.extra else "install that package"
        raise MissingDependencyError(
            f"{what_failed} without a package that is not there ({error.__cause__}): {how}."
        ) from error.__cause__


def _named(source: object) -> str:
    return str(source) if isinstance(source, Path) else f"an object of type {type(source).__name__}"


def _article(found: object) -> str:
    return f"the class {found.__name__}" if isinstance(found, type) else f"an object of type {type(found).__name__}"


def _faults(adapter: Adapter, name: str) -> Iterator[str]:
    for attribute in ("name", "description"):
        if not isinstance(getattr(adapter, attribute, None), str):
            yield f"its {attribute} is {getattr(adapter, attribute, None)!r}; expected a string."
    if adapter.name != name:
        yield f"it is registered as {name!r} and calls itself {adapter.name!r}; the two must agree."
    suffixes = getattr(adapter, "suffixes", None)
    if not _are_strings(suffixes) or not all(s.startswith(".") and s == s.lower() for s in suffixes or ()):
        yield f"its suffixes are {suffixes!r}; expected a tuple of lower-case strings with their dots, as ('.obj',)."
    for attribute in ("types", "requires"):
        if not _are_strings(getattr(adapter, attribute)):
            yield f"its {attribute} are {getattr(adapter, attribute)!r}; expected a tuple of strings."
    if any("." in module for module in adapter.requires):
        yield f"its requires are {adapter.requires!r}; expected top-level modules."
    pairs = adapter.suffix_requires
    if not isinstance(pairs, tuple) or not all(_are_strings(pair) and len(pair) == 2 for pair in pairs):
        yield f"its suffix_requires are {pairs!r}; expected a tuple of pairs, as (('.3mf', 'lxml'),)."
    if not isinstance(adapter.priority, int):
        yield f"its priority is {adapter.priority!r}; expected an integer."
    if adapter.opener is None and type(adapter).open is Adapter.open:
        yield "it has neither a method open() nor an opener."
    if not (adapter.opener is None or callable(adapter.opener) or _is_target(adapter.opener)):
        yield f"its opener is {adapter.opener!r}; expected a function, or its name as 'package.module:function'."
    if not callable(adapter.can_open):
        yield f"its can_open is {adapter.can_open!r}; expected a function of the path."


def _is_target(name: object) -> bool:
    module, colon, attribute = name.partition(":") if isinstance(name, str) else ("", "", "")
    return bool(module and colon and attribute)


def _are_strings(values: object) -> bool:
    return isinstance(values, tuple) and all(isinstance(value, str) for value in values)
