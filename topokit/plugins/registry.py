"""The registry of adapters: registering and listing them, and loading a source with the one named or chosen."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topokit.errors import AdapterError, InputError, MissingDependencyError, Option, UnknownFormatError
from topokit.inputs.files import existing_file, user_path
from topokit.inputs.remote import fetched, is_address, lies_in
from topokit.inputs.unpacking import is_content, kept_in_file, unpacked
from topokit.plugins.adapter import Adapter
from topokit.plugins.adapter_choice import choose, knows
from topokit.plugins.foreign_code import (
    answer_of,
    check_adapter,
    entry_points,
    import_adapter,
    open_with,
    options_of,
    warn_once,
    warned_about,
)
from topokit.plugins.programs import not_named

if TYPE_CHECKING:
    from topokit.shape import Shape

BUILT_IN = {
    "mesh": "topokit.adapters.mesh.entry:MESH",
    "points": "topokit.adapters.points.entry:POINTS",
    "voxels": "topokit.adapters.voxels.entry:VOXELS",
    "sdf": "topokit.adapters.implicit.entry:SDF",
    "occupancy": "topokit.adapters.implicit.entry:OCCUPANCY",
    "splats": "topokit.adapters.splats.entry:SPLATS",
    "open3d": "topokit.adapters.open3d.entry:OPEN3D",
}
_registered: dict[str, str | Adapter] = dict(BUILT_IN)  # an adapter, or where to import it from


def register_adapter(
    name: str | type[Adapter] | None = None,
    target: Any = None,
    *,
    overwrite: bool = False,
    **attributes: Any,
) -> Any:
    """Make an adapter known to `load` and `list_adapters` in this process.

    An installed package needs no call: it declares an entry point of the group "topokit.adapters" (see `Adapter`).

        @register_adapter                                                     # a subclass of Adapter
        @register_adapter("blobs", suffixes=(".blob",), description="blobs")  # a function (path, **options) -> Shape
        register_adapter("blobs", "package.module:Class")                     # imported on the first look-up
        register_adapter("blobs", "package.module:function", suffixes=(".blob",), description="blobs")

    Args:
        name: unique name; a class has its own, and is given instead of it.
        target: a class, a function, or its name as "package.module:name"; left out in a decorator.
        overwrite: whether to replace an adapter of the same name.
        attributes: of a function: those of `Adapter` (`description`, `suffixes`, `types`, `extra`, `requires`,
            `priority`, ...) and `can_open`, a function of the path. A class has its own.

    Returns:
        The target; a decorator if there is none.

    Raises:
        InputError: if the name is taken, or attributes are unknown or given beside a class.
        AdapterError: if the target is no adapter; of a name "package.module:name" this shows on the first look-up.
    """
    if isinstance(name, type):
        name, target = None, name
    if target is None:
        return lambda decorated: register_adapter(name, decorated, overwrite=overwrite, **attributes)
    is_class = isinstance(target, type)
    if is_class and attributes:
        raise InputError(f"{origin(target)} is a class: {', '.join(attributes)} must be attributes of it.")
    called = name or getattr(target, "name", None)
    if not isinstance(called, str):
        raise InputError(f'{origin(target)} needs a name: register_adapter("name", ...).')
    added = target
    if not is_class and (attributes or not isinstance(target, str | Adapter)):
        description = (getattr(target, "__doc__", None) or called).strip().splitlines()[0]
        added = Adapter(**{"name": called, "opener": target, "description": description, "suffixes": (), **attributes})
    if not isinstance(added, str):
        added = check_adapter(added, called)
    taken = _targets().get(called, added)
    old, new = origin(taken), origin(added)
    is_again = taken is added or (old == new and "<lambda>" not in new)  # as in a notebook cell that is run twice
    if not is_again and not overwrite:
        raise InputError(
            f"adapter {called!r} is registered already, by {old}; {new} needs another name, or overwrite=True to "
            "replace it."
        )
    _registered[called] = added
    return target


def list_adapters() -> tuple[Adapter, ...]:
    """Every adapter: what it opens, whether it is `usable`, and what to `install` if not.

    Built-in ones come first, then those registered in this process and those of installed plug-ins. A plug-in that
    cannot be imported is listed with its `problem`. Neither torch nor any reader is imported for this.

    Example:
        >>> import topokit as tk
        >>> [adapter.name for adapter in tk.list_adapters()][:2]
        ['mesh', 'points']
    """
    return tuple(_adapters())


def refresh_adapters() -> None:
    """Look for installed plug-ins again, and retry broken ones: after a `pip install` in a running process."""
    importlib.invalidate_caches()
    _plugins.cache_clear()
    _resolve.cache_clear()
    warned_about.clear()


def registered_here() -> dict[str, str | Adapter]:
    """The adapters that calls of `register_adapter` in this process have made known, by name."""
    return {name: target for name, target in _registered.items() if BUILT_IN.get(name) != target}


def replace_registered(names: Iterable[str], added: Mapping[str, str | Adapter]) -> None:
    """Forget the adapters of these names, or what they replaced built-in ones by, and register others."""
    for name in names:
        _registered.pop(name, None)
    _registered.update(BUILT_IN | _registered | dict(added))


def load(source: Any, *, adapter: str | None = None, format: str | None = None, **options: Any) -> Shape:
    """Open a file, a folder or an object with the adapter that fits its content or suffix.

    Adapters that recognize the content come first, else those with the file's suffix; of these the one with the longest
    matching suffix, then the highest priority. Objects are opened by the adapter that names their class. Networks are
    programs, and run when they are opened: `load` opens one only by its path, its bytes or a file object, and only with
    adapter="sdf" or "occupancy".

    Args:
        source: path of a file, which may be compressed with gzip, or of a folder such as an unzipped .sog; an address
            that fsspec opens, as https://example.org/part.stl, s3://… or zip://part.stl::parts.zip; bytes or a file
            object; or an object of one of the types that `list_adapters` names, such as a `trimesh.Trimesh` or a tuple
            (vertices, faces).
        adapter: name of the adapter to use ("mesh", "points", "voxels", "sdf", "occupancy", "splats", "open3d", or that
            of a plug-in) instead.
        format: what to take a file, bytes or a file object for if the content does not tell: the suffix of a file, as
            "stl" or "xyz". Bytes have none of their own; file objects have that of their name, if they have a name.
        options: passed to the adapter (`n_samples`, `n_neighbors`, `generator`, ...); see the docstring of
            `topokit.from_mesh` and its siblings.

    Returns:
        A `Shape`, which has the file's name unless a plug-in named it.

    Raises:
        ReadError: if the file is missing or malformed.
        UnknownFormatError: if neither content nor suffix is known.
        MissingDependencyError: if it is known, but a package must be installed first.
        InputError: if `adapter` is not known, if several adapters match, if an option does not exist, if objects of
            this type are not opened, or if the file is a program that was not asked for.
        AdapterError: if a plug-in fails or returns something else than a `Shape`.
    """
    if is_address(source):
        if (why := objection(source, adapter)) is not None:
            raise InputError(why)
        with in_reach(source, adapter) as place:
            if isinstance(place, Path):
                return load(place, adapter=adapter, format=format, **options)
            return open_with(adapter_for(place, adapter), place, options)
    if is_content(source):
        with kept_in_file(source, format) as path:
            try:
                return load(path, adapter=adapter, **options)
            except UnknownFormatError as error:
                hint = "" if format else " Or pass the suffix that such files have: format='stl'."
                raise UnknownFormatError(*error.parts, hint) from error
    source = _as_path(source)
    if format is not None:
        if not isinstance(source, Path) or source.is_dir():
            raise InputError(f"format={format!r} is that of a file, of bytes or of a file object; got {source!r}.")
        with source.open("rb") as file:
            return load(file, adapter=adapter, format=format, **options)
    chosen = adapter_for(source, adapter)
    if not isinstance(source, Path):
        return open_with(chosen, source, options)
    return _load_file(chosen, source, options)


def _load_file(adapter: Adapter, path: Path, options: Mapping[str, Any]) -> Shape:
    """The shape of a file or folder; gzip files are unpacked first, unless their suffix is one of the adapter's."""
    from topokit.shape import UNNAMED

    if path.name.lower().endswith(adapter.suffixes):
        shape = open_with(adapter, path, options)
    else:
        with unpacked(path) as plain:
            shape = open_with(adapter, plain, options)
            shape = shape.replace(name=path.name) if shape.name == plain.name else shape
    # A plug-in may return what a built-in adapter made of an object, which is then called "mesh", "sdf", ...
    return shape if shape.name not in {UNNAMED, *BUILT_IN} else shape.replace(name=path.name)


def adapter_for(source: Any, name: str | None = None) -> Adapter:
    """The adapter that `load` opens a source with; same arguments and errors. Of addresses those of `opens_address`."""
    if name is None:
        for found in _adapters():
            if found.problem is not None:
                warn_once(found.name, f"adapter {found.name!r} ({found.description}) is left out: {found.problem}")
        return choose(_working(), source if opens_address(source) else _as_path(source))
    targets = _targets()
    if name not in targets:
        raise InputError(f"adapter {name!r} is not known. Known: {', '.join(targets)}.")
    found = _resolve(name, targets[name])
    if found.problem is not None:
        raise AdapterError(f"adapter {name!r} ({found.description}) is broken: {found.problem}")
    if not found.usable:
        raise MissingDependencyError(f"adapter {name!r} is not usable yet: {found.install}")
    return found


def opens_address(source: object, name: str | None = None) -> bool:
    """Whether an adapter, or that of this name, opens what is at an address where it is, without a copy."""
    return any(lies_in(source, one.addresses) for one in _working() if name in (None, one.name))


def in_reach(source: Any, name: str | None = None) -> AbstractContextManager[Any]:
    """During the block what an adapter can be given: a copy of what is at an address, else the source itself.

    Args:
        source: a path, or an address; one that `opens_address` stays as it is.
        name: of the adapter, or None.
    """
    return fetched(source) if is_address(source) and not opens_address(source, name) else nullcontext(source)


def objection(source: object, name: str | None) -> str | None:
    """Why the adapter of this name does not open what the caller did not name as a file; None if it does."""
    targets = _targets()
    if name is None or name not in targets or _resolve(name, targets[name]).runs_code is None:
        return None
    return not_named(source, name)


def is_known(path: Path, name: str | None = None) -> bool:
    """Whether an adapter knows a file by content or suffix, installed or not; a folder by content.

    Args:
        path: a file or folder that exists.
        name: ask only the adapter of this name, unless it recognizes nothing by itself.
    """
    named = [found for found in _working() if found.name == name and found.suffixes]
    return knows(named or _working(), path)


def shared_by_workers(source: Path | str, name: str, options: Mapping[str, Any]) -> bool:
    """Whether the workers of a cluster are to share a file that the adapter of this name opens with these options."""
    adapter = adapter_for(source, name)
    return adapter.is_large is not None and bool(answer_of(adapter, "is_large", source, options))


def load_labels(source: Path | str, labels: Any, adapter: str, **options: Any) -> Mapping[int, Shape]:
    """The shapes of the labels of a file, by label.

    Args:
        source: a path, or an address that the adapter opens where it is.
        labels: "all", or those that are wanted.
        adapter: name of the adapter.
        options: of its function `open_labels`.

    Raises:
        InputError: if files of this adapter hold no labels, or it has no such option for them.
        TopokitError: as for `load`.
    """
    found = adapter_for(source, adapter)
    if found.open_labels is None:
        having = " and ".join(repr(one.name) for one in _working() if one.open_labels is not None)
        raise InputError(f"{source}: adapter {adapter!r} opens no labels; {having} does.")
    known = options_of(found, "open_labels")
    if known is not None and (wrong := sorted(options.keys() - known.keys())):
        named = [part for name in wrong for part in (", ", Option(name, "…"))][1:]
        raise InputError(f"{source}: with labels there is no ", *named, "; leave it out.")
    shapes: Mapping[int, Shape] = answer_of(found, "open_labels", source, labels, **options)
    return shapes


@cache
def _plugins() -> dict[str, str]:
    """Installed plug-ins by name; one whose name is taken is left out with a warning."""
    found: dict[str, str] = {}
    for name, target, distribution in entry_points():
        taken = origin({**found, **_registered}.get(name, target))
        if taken == target:
            found[name] = target
        else:
            why = f"adapter {name!r} is registered already, by {taken}; {target} needs another name."
            warn_once(f"{name} of {distribution}", f"A plug-in of {distribution} is left out: {why}")
    return found


def _targets() -> dict[str, str | Adapter]:
    """Every adapter by name, as it was registered: built-in ones first, installed plug-ins last."""
    return _registered | _plugins() | _registered


@cache
def _resolve(name: str, target: str | Adapter) -> Adapter:
    """The adapter, imported if need be; in place of a broken one a row that says what is wrong with it."""
    try:
        return import_adapter(target, name) if isinstance(target, str) else target
    except AdapterError as error:
        return Adapter(name=name, description=origin(target), suffixes=(), problem=str(error))


def _adapters() -> list[Adapter]:
    found: dict[str, Adapter] = {}
    while waiting := [name for name in _targets() if name not in found]:  # importing one may register others
        found |= {name: _resolve(name, _targets()[name]) for name in waiting}
    return list(found.values())


def _working() -> list[Adapter]:
    return [found for found in _adapters() if found.problem is None]


def origin(target: Any) -> str:
    """Where an adapter or what names it is written, as "package.module:name"."""
    if type(target) is Adapter:
        target = target.opener
    if isinstance(target, str):
        return target
    named = target if hasattr(target, "__qualname__") else type(target)
    return f"{named.__module__}:{named.__qualname__}"


def _as_path(source: Any) -> Any:
    """Files as paths that exist, folders as paths, objects as they are."""
    if not isinstance(source, str | os.PathLike):
        return source
    path = user_path(source)
    return path if path.is_dir() else existing_file(path)
