"""Which adapter opens a source: by content, then suffix, then priority; what is left of a tie is an error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from topokit.errors import AdapterError, InputError, MissingDependencyError, UnknownFormatError
from topokit.inputs.files import GZIP, ZIP, existing_file, head, heads_read_once
from topokit.plugins.adapter import Adapter, describe
from topokit.plugins.foreign_code import foreign_code, warn_once

_PACKED = {ZIP: "It is a zip archive: unpack it first. ", GZIP: "It is compressed with gzip: unpack it first. "}
_HOW = "docs/adapters.md tells how to write an adapter of your own."


def choose(adapters: Sequence[Adapter], source: object) -> Adapter:
    """The adapter for a source that no name settles.

    Files: of the adapters that recognise the content, or else of those that have the suffix, the one with the longest
    matching suffix, and among those the one with the highest priority. Objects: of the adapters that name a class of
    the object, the one with the highest priority.

    Args:
        adapters: all there are.
        source: a path that exists, or an object.

    Raises:
        UnknownFormatError: if no adapter knows the file.
        MissingDependencyError: if those that do are not usable here.
        InputError: if two are left, or no adapter opens such objects.
    """
    if isinstance(source, Path):
        return _for_path(adapters, source)
    matching = [adapter for adapter in adapters if _is_one_of(adapter.types, source)]
    if not matching:
        raise InputError(_unknown_object(adapters, source))
    return _best(matching, lambda adapter: (adapter.priority,), f"Objects of {_name(type(source))} are opened by")


def _for_path(adapters: Sequence[Adapter], path: Path) -> Adapter:
    def rank(adapter: Adapter) -> tuple[int, ...]:
        return _matched(adapter, path), adapter.priority

    with heads_read_once():
        recognising = [adapter for adapter in adapters if _recognises(adapter, path)]
        if recognising:
            return _best(recognising, rank, f"The content of {path} is recognised by")
        with_suffix = [adapter for adapter in adapters if _matched(adapter, path)]
        if with_suffix:
            return _best(with_suffix, rank, f"The content of {path} is not recognised, and its suffix is that of")
        raise UnknownFormatError(_unknown_file(adapters, path))


def _best(matching: list[Adapter], rank: Callable[[Adapter], tuple[int, ...]], lead: str) -> Adapter:
    usable = [adapter for adapter in matching if describe(adapter).usable]
    if not usable:
        needs = " and ".join(f"{one.name!r}, which needs: {describe(one).install}" for one in matching)
        raise MissingDependencyError(f"{lead} {needs}")
    first = max(map(rank, usable))
    best = [adapter for adapter in usable if rank(adapter) == first]
    if len(best) > 1:
        names = " and ".join(repr(adapter.name) for adapter in best)
        options = " or ".join(f"adapter={adapter.name!r}" for adapter in best)
        raise InputError(f"{lead} the adapters {names}, and nothing decides between them: pass {options}.")
    return best[0]


def _recognises(adapter: Adapter, path: Path) -> bool:
    try:
        with foreign_code(f"adapter {adapter.name!r} could not look at {path}"):
            return bool(adapter.can_open(path))
    except AdapterError as error:
        warn_once(adapter.name, f"{error} It is asked about suffixes alone.")
        return False


def _matched(adapter: Adapter, path: Path) -> int:
    """Length of the adapter's longest suffix that the file's name ends with."""
    name = path.name.lower()
    return max((len(suffix) for suffix in adapter.suffixes if name.endswith(suffix)), default=0)


def _is_one_of(names: Iterable[str], source: object) -> bool:
    """Whether a class of the object is called so where it is defined, or is public so in a module that is loaded.

    An object's classes are loaded, so nothing needs to be imported, and public names survive a move of the class.
    """
    for name in names:
        module, _, attribute = name.rpartition(".")
        public = vars(sys.modules[module]).get(attribute) if module in sys.modules else None
        if any(kind is public or _name(kind) == name for kind in type(source).__mro__):
            return True
    return False


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _unknown_file(adapters: Sequence[Adapter], path: Path) -> str:
    if path.is_dir():
        existing_file(path)  # says what to do with folders
    packed = next((hint for magic, hint in _PACKED.items() if head(path).startswith(magic)), "")
    known = sorted({suffix for adapter in adapters for suffix in adapter.suffixes})
    by_name = " or ".join(repr(one.name) for one in adapters if one.suffixes or not one.types)  # not objects alone
    return (
        f"{path}: {path.suffix.lower() or 'a file without suffix'!r} is not a known format and its content is not one "
        f"either. {packed}Known: {', '.join(known)}. {_not_installed(adapters)}"
        f"Pass adapter={by_name} if you know what it is. {_HOW}"
    )


def _unknown_object(adapters: Sequence[Adapter], source: object) -> str:
    known = ", ".join(sorted({name for adapter in adapters for name in adapter.types}))
    return (
        f"load got {_name(type(source))}; expected a path, or an object of {known}. {_not_installed(adapters)}For "
        "arrays and tensors use topokit.from_points, from_mesh or from_voxels, for functions and networks "
        f"topokit.from_sdf or from_occupancy. {_HOW}"
    )


def _not_installed(adapters: Iterable[Adapter]) -> str:
    found = [info for info in map(describe, adapters) if info.install]
    if not found:
        return ""
    parts = (f"{' '.join(info.missing_suffixes) or info.name} ({info.install})" for info in found)
    return f"Known, but not installed: {', '.join(parts)}. "
