"""Adapter: how one representation is recognized, and how it becomes a Shape."""

from __future__ import annotations

import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.shape import Shape


class Adapter:
    """One representation: how it is recognized, and how it becomes a `Shape`.

    A subclass sets `name`, `description` and `suffixes`, and writes `open` (or names an `opener`). Its constructor
    takes no arguments, and its module imports nothing heavy: it is imported when topokit first chooses an adapter.

        class Rings(topokit.Adapter):
            name, description, suffixes = "rings", "tori by their two radii", (".ring",)

            def open(self, source, *, n_samples=10_000):
                ...
                return topokit.Shape(topokit.SurfaceSamples(points, normals))

    An installed package declares it as an entry point, `rings = "topokit_rings:Rings"` in the group "topokit.adapters";
    a script calls `topokit.register_adapter(Rings)`. `topokit.testing.AdapterConformance` tests it.

    Attributes:
        name: a unique name.
        description: what it opens, in a few words.
        suffixes: of file names, lower case, with their dot; () if only content or objects are recognized.
        types: classes whose objects it opens, as "trimesh.Trimesh": the public name or the module that defines them.
            They are compared without importing anything, so their packages may be missing.
        extra: what to `pip install` to make it usable, as "topokit[open3d]" or "pydicom>=3".
        requires: top-level modules without which it opens nothing.
        suffix_requires: (suffix, module) pairs: modules that only some suffixes need.
        priority: the highest wins where content and suffix leave several adapters.
        opener: the function that opens a source, or its name as "package.module:function", imported when needed.
        addresses: suffixes of folders that it opens at an address where they are, as (".zarr",); of everything else at
            an address it is given a copy.
        open_labels: the function that opens every label of a file as a shape of its own, (source, labels, **options) →
            shapes by label, where labels is "all" or a list; or its name. None if its files hold no labels.
        is_large: a function of a path or address and of the options of `open`, or its name: whether the workers of a
            cluster are to share the file. `open` then gets them as its option `client`, a `dask.distributed.Client`.
        may_open: a function of the path, or its name: whether a file in a folder with one of the suffixes may be of
            this kind. For suffixes that notes and tables have, too; without it all are taken.
        write_kept: a function (source, target, **options), or its name, that writes the part of a file that `open`
            keeps, in its format, and returns a sentence for each part that was dropped and one for what was kept.
        shows_progress: whether it draws a progress bar itself while it opens and examines a file.
        runs_code: None, or a sentence for callers who did not ask for it, if files of its kind are programs that run
            when they are opened. Such an adapter opens only what the caller names, the file itself and the adapter: it
            is never chosen, and takes nothing from folders, patterns and addresses.
        differentiable: whether samples carry a gradient to the tensors of an object given to `open`.
        problem: what is wrong with a broken plug-in, set by topokit.
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
    runs_code: str | None = None
    differentiable: bool = False
    addresses: tuple[str, ...] = ()
    open_labels: str | Callable[..., Mapping[int, Shape]] | None = None
    is_large: str | Callable[..., bool] | None = None
    may_open: str | Callable[[Path], bool] | None = None
    write_kept: str | Callable[..., tuple[str, ...]] | None = None
    shows_progress: bool = False
    problem: str | None = None

    def __init__(self, **attributes: Any) -> None:
        known = [*Adapter.__annotations__, "can_open"]
        if unknown := sorted(attributes.keys() - set(known)):
            called = attributes.get("name", self)
            raise InputError(f"adapter {called!r}: an adapter has no {', '.join(unknown)}. It has: {', '.join(known)}.")
        vars(self).update(attributes)

    def can_open(self, source: Path) -> bool:
        """Whether the content of a file or folder is certainly this representation, whatever its suffix.

        It is asked about every file, so it should read only the first bytes (`topokit.inputs.files.head`).

        Args:
            source: path of a file with content, or of a folder.
        """
        return False

    def open(self, source: Any, **options: Any) -> Shape:
        """The shape of a file or object.

        Args:
            source: path of a file or folder, or an object of one of `types`.
            options: a subclass lists its own as keyword arguments; others are then refused by name.
        """
        opener: Any = self.function("opener")
        return opener(source, **options)

    def function(self, attribute: str) -> Callable[..., Any] | None:
        """The function that an attribute holds, or names as "package.module:function"; None if it is None."""
        found: Any = getattr(self, attribute)
        return pkgutil.resolve_name(found) if isinstance(found, str) else found

    def options(self, attribute: str = "open") -> Mapping[str, inspect.Parameter] | None:
        """The options of `open`, or of `open_labels`, by name; None if it takes any."""
        is_opener = attribute == "open" and type(self).open is Adapter.open
        function: Any = self.function("opener" if is_opener else attribute)
        try:
            signature = inspect.signature(function, eval_str=True)
        except NameError:  # annotations with names that are imported for type checkers only
            signature = inspect.signature(function)
        parameters = list(signature.parameters.values())[1:]
        if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
            return None
        return {one.name: one for one in parameters if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)}

    @property
    def usable(self) -> bool:
        """Whether it can open anything."""
        return self.problem is None and all(map(_is_installed, self.requires))

    @property
    def missing_suffixes(self) -> tuple[str, ...]:
        """Suffixes that cannot be opened until something is installed."""
        lacking = {suffix for suffix, module in self.suffix_requires if not _is_installed(module)}
        return tuple(suffix for suffix in self.suffixes if suffix in lacking or not self.usable)

    @property
    def install(self) -> str | None:
        """The command that installs what is missing, or None."""
        wanted = {*self.requires, *(module for _, module in self.suffix_requires)}
        missing = sorted(module for module in wanted if not _is_installed(module))
        packages = f'"{self.extra}"' if self.extra else " ".join(missing)
        return f"pip install {packages}" if missing else None

    @property
    def state(self) -> str:
        """ "usable", perhaps with what some suffixes need besides; or what has to be installed or is broken."""
        if self.problem is not None:
            return f"broken: {self.problem}"
        if self.usable and self.install:
            return f"usable; for {' '.join(self.missing_suffixes)}: {self.install}"
        return "usable" if self.usable else str(self.install)


def _is_installed(module: str) -> bool:
    """Whether a module could be imported, without importing it."""
    return sys.modules[module] is not None if module in sys.modules else importlib.util.find_spec(module) is not None
