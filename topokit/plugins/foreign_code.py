"""The code of plug-ins is imported, checked and called here, and whatever it raises becomes one clear error."""

from __future__ import annotations

import pkgutil
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topokit.errors import AdapterError, AdapterWarning, InputError, MissingDependencyError, TopokitError, summary
from topokit.inputs.calls import no_option
from topokit.plugins.adapter import Adapter

if TYPE_CHECKING:
    from topokit.shape import Shape

warned_about: set[str] = set()  # names of broken plug-ins


@contextmanager
def foreign_code(what_failed: str, adapter: Adapter | None = None) -> Iterator[None]:
    """Raise whatever the block raises as an `AdapterError` that begins with `what_failed`; our own errors pass.

    This is the one place of topokit that catches everything. A plug-in may raise exceptions of its own, which no list
    can name, and a broken one must not stop the others. Nothing is lost: the exception stays attached as the cause.
    SystemExit and KeyboardInterrupt pass.

    Args:
        what_failed: beginning of the message.
        adapter: whose code it is; an ImportError then becomes a `MissingDependencyError` that says what to install.
    """
    try:
        yield
    except TopokitError:
        raise
    except Exception as error:
        if adapter is None or not isinstance(error, ImportError):
            raise AdapterError(f"{what_failed} ({summary(error)}).") from error
        how = f'pip install "{adapter.extra}"' if adapter.extra else "install it"
        raise MissingDependencyError(f"{what_failed}: a package is missing ({error}); {how}.") from error


def warn_once(name: str, message: str) -> None:
    """Warn about a broken plug-in, the first time that it is met."""
    if name not in warned_about:
        warned_about.add(name)
        warnings.warn(message, AdapterWarning, stacklevel=2)


def entry_points() -> list[tuple[str, str, str]]:
    """(name, "package.module:Class", distribution) of every installed plug-in, in a fixed order."""
    from importlib import metadata

    found = metadata.entry_points(group="topokit.adapters")
    return sorted(
        {(one.name, one.value.partition("[")[0].strip(), one.dist.name if one.dist else "?") for one in found}
    )


def import_adapter(target: str, name: str) -> Adapter:
    """The adapter that "package.module:Class" names, checked.

    Raises:
        AdapterError: if it cannot be imported or is no adapter.
    """
    if not _is_target(target):
        raise AdapterError(f"it is given as {target!r}; expected 'package.module:Class'.")
    with foreign_code(f"{target} could not be imported"):
        found = pkgutil.resolve_name(target)
    return check_adapter(found, name)


def check_adapter(found: object, name: str) -> Adapter:
    """An instance of what a plug-in gave, which is a subclass of `Adapter` or an instance.

    Raises:
        AdapterError: if it is something else, has a wrong attribute, or another name than `name`.
    """
    if not (isinstance(found, type) and issubclass(found, Adapter)) and not isinstance(found, Adapter):
        raise AdapterError(f"it is {_kind(found)}; expected a subclass of topokit.Adapter.")
    with foreign_code("it cannot be made without arguments"):
        adapter = found() if isinstance(found, type) else found
    for attributes, is_right, expected in _CHECKS:
        for attribute in attributes:
            if not is_right(value := getattr(adapter, attribute, None)):
                verb = "are" if attribute.endswith("s") else "is"
                raise AdapterError(f"its {attribute} {verb} {value!r}; expected {expected}.")
    if adapter.name != name:
        raise AdapterError(f"it is registered as {name!r}, but its name is {adapter.name!r}; the two must agree.")
    if adapter.opener is None and type(adapter).open is Adapter.open:
        raise AdapterError("it has neither a method open() nor an opener.")
    return adapter


def options_of(adapter: Adapter, attribute: str = "open") -> Mapping[str, Parameter] | None:
    """The options of an adapter by name, None if it takes any; imports its opener. See `Adapter.options`."""
    with foreign_code(f"the options of adapter {adapter.name!r} could not be read", adapter):
        return adapter.options(attribute)


def answer_of(adapter: Adapter, attribute: str, *given: Any, **options: Any) -> Any:
    """What the function that is an attribute of an adapter, such as `is_large`, returns for a source and more.

    Raises:
        TopokitError: the adapter's own.
        MissingDependencyError: if it lacks a package.
        AdapterError: if it raises anything else.
    """
    with foreign_code(f"{attribute} of adapter {adapter.name!r} failed for {given[0]}", adapter):
        function: Any = adapter.function(attribute)
        return function(*given, **options)


def open_with(adapter: Adapter, source: Any, options: Mapping[str, Any]) -> Shape:
    """The shape that an adapter makes of a source; `n_neighbors` need not be an option of the adapter.

    Raises:
        InputError: if it has no such option.
        TopokitError: the adapter's own; about samples with the file's name.
        MissingDependencyError: if it lacks a package.
        AdapterError: if it raises anything else, or returns something else than a `Shape`.
    """
    from topokit.shape import Shape

    known = options_of(adapter)
    if known is not None and (wrong := options.keys() - known.keys() - {"n_neighbors"}):
        raise InputError(no_option(f"adapter {adapter.name!r}", wrong, {*known, "n_neighbors"}))
    what = f"adapter {adapter.name!r} could not open {source if isinstance(source, Path) else _kind(source)}"
    try:
        with foreign_code(what, adapter):
            shape = adapter.open(source, **{k: v for k, v in options.items() if known is None or k in known})
    except InputError as error:
        if error.file is not None or not isinstance(source, Path):
            raise
        raise InputError(f"{source} (adapter {adapter.name!r}): ", *error.parts, file=source) from error
    if not isinstance(shape, Shape):
        raise AdapterError(f"{what}: it returned {_kind(shape)}; a topokit.Shape was expected.")
    return shape.replace(n_neighbors=options["n_neighbors"]) if "n_neighbors" in options else shape


def _kind(found: object) -> str:
    return f"the class {found.__name__}" if isinstance(found, type) else f"an object of type {type(found).__name__}"


def _is_target(value: object) -> bool:
    return isinstance(value, str) and all(value.partition(":"))


def _are_strings(values: object) -> bool:
    return isinstance(values, tuple) and all(isinstance(value, str) for value in values)


def _are_suffixes(values: Any) -> bool:
    return _are_strings(values) and all(value.startswith(".") and value == value.lower() for value in values)


def _are_pairs(values: Any) -> bool:
    return isinstance(values, tuple) and all(_are_strings(pair) and len(pair) == 2 for pair in values)


def _is_function(value: Any) -> bool:
    return value is None or callable(value) or _is_target(value)


# Attributes, what they must be, and how to say that.
_CHECKS: tuple[tuple[tuple[str, ...], Callable[[Any], bool], str], ...] = (
    (("name", "description"), lambda value: isinstance(value, str), "a string"),
    (("suffixes", "addresses"), _are_suffixes, "a tuple of lower-case strings with their dots, as ('.obj',)"),
    (("types", "requires"), _are_strings, "a tuple of strings"),
    (("requires",), lambda modules: not any("." in module for module in modules), "top-level modules"),
    (("suffix_requires",), _are_pairs, "a tuple of pairs, as (('.3mf', 'lxml'),)"),
    (("priority",), lambda value: isinstance(value, int), "an integer"),
    (("shows_progress",), lambda value: isinstance(value, bool), "True or False"),
    (("runs_code",), lambda value: value is None or (isinstance(value, str) and value != ""), "a sentence, or None"),
    (
        ("opener", "open_labels", "is_large", "may_open", "write_kept"),
        *(_is_function, "a function, or its name as 'package.module:function'"),
    ),
    (("can_open",), callable, "a function of the path"),
)
