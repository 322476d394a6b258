"""Adapters that were registered in this process, on their way to the processes that examine its files.

They travel by cloudpickle. What a module on the path defines is sent by name, as pickle does it; what a script, a
notebook or a function defines is sent as code, so that nobody imports the script again and it needs no guard.
"""

from __future__ import annotations

import pickle
import sys

import cloudpickle

from topokit.errors import InputError, summary
from topokit.plugins import registry
from topokit.plugins.adapter import Adapter
from topokit.plugins.foreign_code import foreign_code

_agreed = b""  # what was sent or received last: the registry holds these adapters already
_received: set[str] = set()


def packed_adapters() -> bytes:
    """The adapters that were registered in this process, for `know_adapters`.

    Raises:
        InputError: if one holds something that cannot be sent, such as an open file.
    """
    global _agreed
    packed = {}
    for name, target in registry.registered_here().items():
        _send_as_code(registry.origin(target).partition(":")[0])
        try:
            packed[name] = cloudpickle.dumps(target)
        except (pickle.PicklingError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"adapter {name!r} was registered in this process and cannot be sent to others ({summary(error)}). "
                "Let it create what it holds in open(), declare it in an installed package, or pass jobs=1 without "
                "limits."
            ) from error
    _agreed = pickle.dumps(packed)
    return _agreed


def know_adapters(content: bytes) -> None:
    """Register the adapters of the process that asks, in place of those that were received before.

    Args:
        content: of `packed_adapters`.

    Raises:
        AdapterError: if one cannot be made here, as when its module cannot be imported.
    """
    global _agreed
    if content == _agreed:
        return
    sent = {name: _unpacked(name, target) for name, target in pickle.loads(content).items()}
    registry.replace_registered(_received, sent)
    _received.clear()
    _received.update(sent)
    _agreed = content


def _unpacked(name: str, target: bytes) -> str | Adapter:
    with foreign_code(f"adapter {name!r} of the calling process cannot be made in this one"):
        adapter: str | Adapter = pickle.loads(target)
    return adapter


def _send_as_code(module: str) -> None:
    """Let cloudpickle send a module as code if no other process finds it by its name, as one loaded from a path."""
    top = module.partition(".")[0]
    if module in sys.modules and module != "__main__" and not any(_finds(finder, top) for finder in sys.meta_path):
        cloudpickle.register_pickle_by_value(sys.modules[module])


def _finds(finder: object, module: str) -> bool:
    find_spec = getattr(finder, "find_spec", None)
    return find_spec is not None and find_spec(module, None) is not None
