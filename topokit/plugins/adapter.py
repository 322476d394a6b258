"""Adapter: what recognises one representation and turns it into a Shape."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.shape import Shape


class Adapter:
    """One representation: how it is recognised, and how it becomes a `Shape`.

    A subclass gives `name`, `description` and `suffixes`, and either overrides `open` or names an `opener`. It takes no
    arguments. Its module should import nothing heavy: it is imported when topokit first chooses between adapters.

    Attributes:
        name: a word of its own, unlike every other adapter's.
        description: what it opens, in a few words.
        suffixes: of file names, lower case, with their dot; () where only content or objects are recognised.
        types: classes whose objects it opens, as "trimesh.Trimesh": the public name or the one in the module that
            defines them. They are compared without importing anything, so they may be missing.
        extra: what `pip install` is to be given to make it usable, as "topokit[open3d]" or "pydicom>=3".
        requires: modules (top level) without which nothing can be opened.
        suffix_requires: (suffix, module) pairs: what single suffixes need besides.
        priority: the higher goes first where content and suffix leave several adapters.
        opener: a function that opens, or its name as "package.module:function", imported when it is needed.
        differentiable: whether samples carry a gradient to the tensors of an object given to `open`.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    types: tuple[str, ...] = ()
    extra: str | None = None
    requires: tuple[str, ...] = ()
    suffix_requires: tuple[tuple[str, str], ...] = ()
    priority: int = 0
    opener: str | Callable[..., Shape] | None = None
    differentiable: bool = False

    def can_open(self, source: Path) -> bool:
        """Whether the content of a file or folder is this representation, beyond doubt; the suffix does not count.

        It is asked for every file, so it should look at the first bytes alone (`topokit.inputs.files.head`).

        Args:
            source: path of a file with content, or of a folder.
        """
        return False

    def open(self, source: Any, **options: Any) -> Shape:
        """The shape of a file or object.

        A subclass writes the options that it takes as keyword arguments, so that others can be refused by name.

        Args:
            source: path of a file or folder, or an object of one of `types`.
            options: what the opener takes.
        """
        return self._opener()(source, **options)

    def options(self) -> frozenset[str] | None:
        """Names of the options of `open`; None if it takes any."""
        own = type(self).open is not Adapter.open
        parameters = list(inspect.signature(self.open if own else self._opener()).parameters.values())[1:]
        if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
            return None
        return frozenset(p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY))

    def _opener(self) -> Callable[..., Shape]:
        if not isinstance(self.opener, str):
            assert self.opener is not None, "an adapter without open() and opener is refused when it is registered"
            return self.opener
        module, _, function = self.opener.partition(":")
        opener: Callable[..., Shape] = getattr(import_module(module), function)
        return opener


class AdapterAttributes(TypedDict, total=False):
    """What `register_adapter` may be told of a function."""

    description: str
    suffixes: tuple[str, ...]
    types: tuple[str, ...]
    extra: str | None
    requires: tuple[str, ...]
    suffix_requires: tuple[tuple[str, str], ...]
    priority: int
    differentiable: bool
    can_open: Callable[[Path], bool]


class FunctionAdapter(Adapter):
    """The adapter that a function is: it opens, and everything else is said beside it."""

    def __init__(self, name: str, opener: str | Callable[..., Shape], attributes: AdapterAttributes) -> None:
        self.name, self.opener, self.suffixes = name, opener, ()
        self.description = (getattr(opener, "__doc__", None) or name).strip().splitlines()[0]
        unknown = sorted(set(attributes) - set(AdapterAttributes.__annotations__))
        if unknown:
            raise InputError(
                f"adapter {name!r}: an adapter has no {', '.join(unknown)}. "
                f"It has: {', '.join(AdapterAttributes.__annotations__)}."
            )
        for attribute, value in attributes.items():
            setattr(self, attribute, value)


@dataclass(frozen=True)
class AdapterInfo:
    """An adapter as `list_adapters` shows it.

    Attributes:
        name, description, suffixes, types: the adapter's own.
        usable: whether it can open anything at all.
        missing_suffixes: those of its suffixes that cannot be opened before something is installed.
        install: the line that installs what is missing, or None.
        problem: what is wrong with a broken plug-in, or None.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    types: tuple[str, ...]
    usable: bool
    missing_suffixes: tuple[str, ...] = ()
    install: str | None = None
    problem: str | None = None

    @property
    def state(self) -> str:
        """ "usable", with what single suffixes need besides, or what is in the way."""
        if self.problem is not None:
            return f"broken: {self.problem}"
        if self.usable and self.install:
            return f"usable; for {' '.join(self.missing_suffixes)}: {self.install}"
        return "usable" if self.usable else str(self.install)


def describe(adapter: Adapter) -> AdapterInfo:
    """What an adapter opens, and what it lacks here."""
    missing = [module for module in adapter.requires if not _is_there(module)]
    lacking = [pair for pair in adapter.suffix_requires if not _is_there(pair[1])]
    closed = adapter.suffixes if missing else tuple(s for s in adapter.suffixes if s in dict(lacking))
    wanted = sorted({*missing, *(module for _, module in lacking)})
    line = f'pip install "{adapter.extra}"' if adapter.extra else f"pip install {' '.join(wanted)}"
    return AdapterInfo(
        adapter.name,
        adapter.description,
        adapter.suffixes,
        adapter.types,
        usable=not missing,
        missing_suffixes=closed,
        install=line if wanted else None,
    )


def _is_there(module: str) -> bool:
    """Whether a module could be imported; it is not."""
    if module in sys.modules:
        return sys.modules[module] is not None
    return importlib.util.find_spec(module) is not None
