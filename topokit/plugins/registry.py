"""The table of adapters: registering, listing, and opening a source with the one that is asked for or chosen."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, Unpack, overload

from topokit.errors import AdapterError, InputError, MissingDependencyError, TopokitError
from topokit.inputs.files import existing_file
from topokit.plugins.adapter import Adapter, AdapterAttributes, AdapterInfo, FunctionAdapter, describe
from topokit.plugins.choice import choose
from topokit.plugins.foreign_code import as_adapter, entry_points, imported, opened, option_names, warn_once

if TYPE_CHECKING:
    from topokit.shape import Shape

Target = TypeVar("Target", bound=Callable[..., Any])
_BUILT_IN = {
    "mesh": "topokit.adapters.mesh.entry:Mesh",
    "points": "topokit.adapters.points.entry:Points",
    "voxels": "topokit.adapters.voxels.entry:Voxels",
    "sdf": "topokit.adapters.implicit.entry:Sdf",
    "occupancy": "topokit.adapters.implicit.entry:Occupancy",
    "splats": "topokit.adapters.splats.entry:Splats",
    "open3d": "topokit.adapters.open3d.entry:Open3D",
}


@dataclass
class _Entry:
    """One row: where it comes from, and the adapter once somebody has asked for it, or what is wrong with it."""

    origin: str
    target: object
    adapter: Adapter | None = None
    problem: str | None = None


class AdapterTable:
    """Adapters by name. Those given as strings, and installed plug-ins, are imported on the first look-up."""

    def __init__(self) -> None:
        self._entries: dict[str, _Entry] = {}
        self._knows_plugins = False

    def add(self, name: str, target: object, overwrite: bool = False) -> None:
        """Enter an adapter: a subclass of `Adapter`, an instance, or "package.module:Class".

        What is written in the same place may be entered again, as when a cell of a notebook is run twice.

        Raises:
            InputError: if the name is taken by something else and `overwrite` is False.
            AdapterError: if it is no adapter; of a string this is found out on the first look-up.
        """
        entry = _Entry(_origin(target), target)
        if not isinstance(target, str):
            entry.adapter = as_adapter(target, name)
        taken = self._entries.get(name)
        is_again = taken is not None and taken.origin == entry.origin and "<lambda>" not in entry.origin
        if taken is not None and not is_again and not overwrite:
            raise InputError(
                f"adapter {name!r} is registered already, by {taken.origin}; {entry.origin} needs another name, or "
                "overwrite=True to replace it."
            )
        self._entries[name] = entry

    def get(self, name: str) -> Adapter:
        """The adapter of this name.

        Raises:
            InputError: if there is none.
            AdapterError: if it is broken.
        """
        if name not in self._entries:
            self._find_plugins()
        if name not in self._entries:
            raise InputError(f"adapter {name!r} is not known. Known: {', '.join(self._entries)}.")
        entry = self._resolved(name)
        if entry.adapter is None:
            raise AdapterError(f"adapter {name!r} ({entry.origin}) is broken: {entry.problem}")
        return entry.adapter

    def all(self) -> list[Adapter]:
        """Every adapter that works; a broken one is a warning."""
        entries = self._all_entries()
        for name, entry in entries.items():
            if entry.problem is not None:
                warn_once(name, f"adapter {name!r} ({entry.origin}) is left out: {entry.problem}")
        return [entry.adapter for entry in entries.values() if entry.adapter is not None]

    def rows(self) -> tuple[AdapterInfo, ...]:
        """What `list_adapters` shows."""
        return tuple(
            AdapterInfo(name, entry.origin, (), (), usable=False, problem=entry.problem)
            if entry.adapter is None
            else describe(entry.adapter)
            for name, entry in self._all_entries().items()
        )

    def _all_entries(self) -> dict[str, _Entry]:
        self._find_plugins()
        while waiting := [name for name, one in self._entries.items() if one.adapter is None and one.problem is None]:
            for name in waiting:  # importing one may register others
                self._resolved(name)
        return self._entries

    def _find_plugins(self) -> None:
        if self._knows_plugins:
            return
        self._knows_plugins = True
        for name, target, distribution in entry_points():
            try:
                self.add(name, target)
            except InputError as error:
                warn_once(f"{name} of {distribution}", f"A plug-in of {distribution} is left out: {error}")

    def _resolved(self, name: str) -> _Entry:
        entry = self._entries[name]
        if entry.adapter is None and entry.problem is None:
            try:
                found = imported(entry.target) if isinstance(entry.target, str) else entry.target
                entry.adapter = as_adapter(found, name)
            except TopokitError as error:
                entry.problem = str(error)
            self._entries[name] = entry  # importing it may have registered it a second time
        return entry


def _origin(target: object) -> str:
    """Where a target is written, as "package.module:name"."""
    if isinstance(target, FunctionAdapter):
        target = target.opener
    if isinstance(target, str):
        return target
    named = target if hasattr(target, "__qualname__") else type(target)
    return f"{named.__module__}:{named.__qualname__}"


_TABLE = AdapterTable()


@overload
def register_adapter(name: type[Adapter]) -> type[Adapter]: ...
@overload
def register_adapter(
    name: str,
    target: str | type[Adapter] | Callable[..., Shape],
    *,
    overwrite: bool = False,
    **attributes: Unpack[AdapterAttributes],
) -> None: ...
@overload
def register_adapter(
    name: str | None = None, *, overwrite: bool = False, **attributes: Unpack[AdapterAttributes]
) -> Callable[[Target], Target]: ...


def register_adapter(
    name: str | type[Adapter] | None = None,
    target: str | Callable[..., Any] | None = None,
    *,
    overwrite: bool = False,
    **attributes: Unpack[AdapterAttributes],
) -> Any:
    """Make an adapter known to `load`, to the command line and to `list_adapters`, in this process.

    Installed packages rather declare theirs as an entry point of the group "topokit.adapters", and need no call.

        @register_adapter                                                    # a subclass of Adapter
        @register_adapter("blobs", suffixes=(".blob",), description="blobs")  # a function (path, **options) -> Shape
        register_adapter("blobs", "package.module:Class")                    # imported on the first look-up
        register_adapter("blobs", "package.module:function", suffixes=(".blob",), description="blobs")

    Args:
        name: its name; left out for a class, which has one.
        target: a class, a function, or where to find it, as "package.module:name"; left out in a decorator.
        overwrite: whether to replace an adapter of the same name.
        attributes: of a function, those of `Adapter` (`description`, `suffixes`, `types`, `extra`, `requires`,
            `priority`, ...) and `can_open`, a function of the path. A class has its own.

    Raises:
        InputError: if the name is taken, or attributes are given beside a class.
        AdapterError: if the target is no adapter.
    """
    if name is not None and not isinstance(name, str):
        register_adapter(None, overwrite=overwrite)(name)
        return name

    def register(target: Target) -> Target:
        _register(name, target, overwrite, attributes)
        return target

    return register if target is None else _register(name, target, overwrite, attributes)


def _register(
    name: str | None, target: str | Callable[..., Any], overwrite: bool, attributes: AdapterAttributes
) -> None:
    is_class = isinstance(target, type)
    if is_class and attributes:
        raise InputError(f"{_origin(target)} is a class: {', '.join(attributes)} must be attributes of it.")
    called = name or getattr(target, "name", None)
    if not isinstance(called, str):
        raise InputError(f'{_origin(target)} needs a name: register_adapter("name", ...).')
    is_function = not is_class and (bool(attributes) or not isinstance(target, str))
    _TABLE.add(called, FunctionAdapter(called, target, attributes) if is_function else target, overwrite)


def list_adapters() -> tuple[AdapterInfo, ...]:
    """Every adapter there is: name, description, suffixes, types, whether it is usable, and what to install if not.

    Built-in ones come first, then those registered in this process and those of installed plug-ins. A plug-in that
    cannot be imported is listed with its problem. Neither torch nor any reader is imported for this.

    Example:
        >>> import topokit as tk
        >>> [adapter.name for adapter in tk.list_adapters()][:2]
        ['mesh', 'points']
    """
    return _TABLE.rows()


def load(source: Any, *, adapter: str | None = None, **options: Any) -> Shape:
    """Open a file, a folder or an object with the adapter that its content, or failing that its suffix, asks for.

    Args:
        source: path of a file, or of a folder such as an unzipped .sog; or an object of one of the types that
            `list_adapters` names, such as a `trimesh.Trimesh`.
        adapter: name of the adapter ("mesh", "points", "voxels", "sdf", "occupancy", "splats", "open3d", or that of a
            plug-in) that settles the choice. How it is made otherwise is told in docs/adapters.md.
        options: handed on to the adapter (`n_samples`, `n_neighbors`, `generator`, ...); see its docstring.

    Raises:
        ReadError: if the file is missing or malformed.
        UnknownFormatError: if neither content nor suffix is known.
        MissingDependencyError: if it is known, but something must be installed first.
        InputError: if `adapter` is not known, if several adapters match, if an option does not exist, or if objects of
            this type are not opened.
        AdapterError: if a plug-in fails or returns something else than a `Shape`.
    """
    chosen = adapter_for(source, adapter)
    known = option_names(chosen)
    if known is not None and (wrong := sorted(set(options) - known - {"n_neighbors"})):
        raise InputError(
            f"adapter {chosen.name!r} has no option {', '.join(map(repr, wrong))}. "
            f"It has: {', '.join(sorted({*known, 'n_neighbors'}))}."
        )
    return opened(chosen, _as_path(source), options)


def load_with(source: Any, offered: Mapping[str, Any]) -> Shape:
    """`load` with those of the options that the chosen adapter takes: a cloud is not sampled, so it takes no seed."""
    chosen = adapter_for(source)
    known = option_names(chosen)
    taken = {name: value for name, value in offered.items() if known is None or name in {*known, "n_neighbors"}}
    return opened(chosen, _as_path(source), taken)


def adapter_for(source: Any, name: str | None = None) -> Adapter:
    """The adapter that `load` opens a source with; arguments and errors are its."""
    source = _as_path(source)
    if name is None:
        return choose(_TABLE.all(), source)
    found = _TABLE.get(name)
    info = describe(found)
    if not info.usable:
        raise MissingDependencyError(f"adapter {name!r} is not usable yet: {info.install}")
    return found


def _as_path(source: Any) -> Any:
    """Files as paths that exist, folders as paths, objects as they are."""
    if not isinstance(source, str | os.PathLike):
        return source
    path = Path(source)
    return path if path.is_dir() else existing_file(path)


for _name, _target in _BUILT_IN.items():
    register_adapter(_name, _target)
