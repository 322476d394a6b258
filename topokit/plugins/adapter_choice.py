"""The choice of an adapter for a source: by content, else by suffix; then by longest suffix and priority."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from topokit.errors import AdapterError, InputError, MissingDependencyError, Option, UnknownFormatError
from topokit.inputs.files import ZIP, existing_file, head, require_beginning
from topokit.inputs.remote import is_address, lies_in
from topokit.inputs.unpacking import unpacked
from topokit.plugins.adapter import Adapter
from topokit.plugins.foreign_code import foreign_code, warn_once
from topokit.plugins.programs import alternatives, not_asked_for

_PACKED = "It is a zip archive: unpack it first. "
_TO_EXPORT = dict.fromkeys(
    (".step", ".stp", ".iges", ".igs", ".brep", ".3dm", ".sldprt", ".fbx", ".blend", ".usd", ".usdz", ".max"),
    "Export the shape as STL or OBJ.",
) | {
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".bmp"), "Write the slices of a volume as one .tif, .nii or .npy."),
    ".vtp": "Open it with PyVista and pass the mesh to topokit.from_mesh, or save it as .ply or .stl.",
}
"""Formats that are often tried, by suffix, and what to do with them."""
_HOW = "For a format of your own write an adapter: help(topokit.Adapter) shows how."


def choose(adapters: Sequence[Adapter], source: object) -> Adapter:
    """The adapter that opens a source, if none is named.

    Files: of the adapters that recognize the content, or else of those with the suffix, the one with the longest
    matching suffix, and among those the one with the highest priority; none that runs code. Objects: of the adapters
    that name a class of the object, the one with the highest priority.

    Args:
        adapters: the adapters to choose from.
        source: a path that exists, an address that one of them opens where it is, or an object.

    Raises:
        UnknownFormatError: if no adapter knows the file.
        MissingDependencyError: if those that do lack packages.
        ReadError: if two are left because the content is damaged or contradicts the suffix.
        InputError: if two are left, if the file is a program, or if no adapter opens such objects.
    """
    if is_address(source):
        lead = f"The address {source} is opened by"
        matching = [adapter for adapter in adapters if lies_in(source, adapter.addresses)]
    elif not isinstance(source, Path):
        lead = f"Objects of {_name(source)} are opened by"
        matching = [adapter for adapter in adapters if _is_instance(source, adapter.types)]
    elif matching := [adapter for adapter in adapters if _recognizes(adapter, source)]:
        lead = f"The content of {source} is recognized by"
    else:
        lead = f"The content of {source} is not recognized, and its suffix is that of"
        matching = [adapter for adapter in adapters if _suffix_length(adapter, source)]
    if not matching:
        raise _unknown_file(adapters, source) if isinstance(source, Path) else _unknown_object(adapters, source)
    if isinstance(source, Path):
        harmless = [adapter for adapter in matching if adapter.runs_code is None]
        if not harmless:
            raise not_asked_for(matching, lead)
        matching = harmless
    usable = [adapter for adapter in matching if adapter.usable]
    if not usable:
        needs = " and ".join(f"{adapter.name!r}, which needs: {adapter.install}" for adapter in matching)
        raise MissingDependencyError(f"{lead} {needs}")
    return _best(usable, source, lead)


def knows(adapters: Sequence[Adapter], path: Path) -> bool:
    """Whether any of the adapters may open a file by its suffix, or recognizes its content, or that of a folder."""
    if path.is_file() and any(_suffix_length(adapter, path) and _may_open(adapter, path) for adapter in adapters):
        return True
    return os.access(path, os.R_OK) and any(_recognizes(adapter, path) for adapter in adapters)


def _best(matching: list[Adapter], source: object, lead: str) -> Adapter:
    """The adapter with the longest matching suffix and, among equals, the highest priority.

    Raises:
        ReadError: if several are left because the file is damaged or is not what its suffix says.
        InputError: if several are left all the same.
    """

    def rank(adapter: Adapter) -> tuple[int, int]:
        return _suffix_length(adapter, source) if isinstance(source, Path) else 0, adapter.priority

    best = max(matching, key=rank)
    names = [repr(adapter.name) for adapter in matching if rank(adapter) == rank(best)]
    if len(names) > 1:
        if isinstance(source, Path) and source.is_file() and not _recognizes(best, source):
            with unpacked(source) as plain:
                require_beginning(plain)
        equal = f"{lead} the adapters {' and '.join(names)}, which rank equally: pass "
        raise InputError(equal, *alternatives(names), ".")
    return best


def _recognizes(adapter: Adapter, path: Path) -> bool:
    return _asked(adapter, "can_open", path, otherwise=False)


def _may_open(adapter: Adapter, path: Path) -> bool:
    """Whether a file with one of the adapter's suffixes may be of its kind."""
    return adapter.may_open is None or not os.access(path, os.R_OK) or _asked(adapter, "may_open", path, otherwise=True)


def _asked(adapter: Adapter, attribute: str, path: Path, otherwise: bool) -> bool:
    try:
        with foreign_code(f"adapter {adapter.name!r} could not examine {path}"):
            function: Any = adapter.function(attribute)
            return bool(function(path))
    except AdapterError as error:
        warn_once(adapter.name, f"{error} Only its suffixes are used.")
        return otherwise


def _suffix_length(adapter: Adapter, path: Path) -> int:
    """Length of the adapter's longest suffix that the file's name ends with, also before .gz."""
    name = path.name.lower()
    endings = (name, name.removesuffix(".gz"))
    return max((len(suffix) for suffix in adapter.suffixes if any(one.endswith(suffix) for one in endings)), default=0)


def _is_instance(source: object, names: Sequence[str]) -> bool:
    """Whether the object is of a class of one of these names; what is not imported has no objects, so nothing is."""
    places = (name.rpartition(".") for name in names)
    kinds = [vars(sys.modules[module]).get(kind) for module, _, kind in places if module in sys.modules]
    return any(isinstance(kind, type) and isinstance(source, kind) for kind in kinds)


def _name(source: object) -> str:
    return f"{type(source).__module__}.{type(source).__qualname__}"


def _unknown_file(adapters: Sequence[Adapter], path: Path) -> UnknownFormatError:
    if path.is_dir():
        existing_file(path)  # its error says what to do with a folder
    suffix = path.suffix.lower()
    if suffix in _TO_EXPORT:
        return UnknownFormatError(f"{path}: topokit does not read {suffix} files. {_TO_EXPORT[suffix]}")
    packed = _PACKED if head(path).startswith(ZIP) else ""
    what = f"{suffix!r} is not a known format, and its content is not one either"
    what = what if suffix else "it has no suffix, and its content is not a known format"
    known = sorted({suffix for adapter in adapters for suffix in adapter.suffixes})
    names = ", ".join(repr(one.name) for one in adapters if one.suffixes or not one.types)  # not objects alone
    return UnknownFormatError(
        f"{path}: {what}. {packed}Known: {', '.join(known)}. {_not_installed(adapters)}If you know what it is, pass ",
        *(Option("adapter", "…"), f", one of {names}. {_HOW}"),
    )


def _unknown_object(adapters: Sequence[Adapter], source: object) -> InputError:
    known = ", ".join(sorted({name for adapter in adapters for name in adapter.types}))
    return InputError(
        f"load got {_name(source)}, which is no path. For arrays and tensors use topokit.from_points, from_mesh or "
        "from_voxels, for functions and networks topokit.from_sdf or from_occupancy. "
        f"Objects that load takes: {known}. {_not_installed(adapters)}{_HOW}"
    )


def _not_installed(adapters: Sequence[Adapter]) -> str:
    lacking = [adapter for adapter in adapters if adapter.install]
    parts = (f"{' '.join(adapter.missing_suffixes) or adapter.name} ({adapter.install})" for adapter in lacking)
    return f"Known, but not installed: {', '.join(parts)}. " if lacking else ""
