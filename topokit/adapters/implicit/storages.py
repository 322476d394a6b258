"""Tensors in archives of torch.save and TorchScript: each must lie within the bytes that its member holds.

torch.jit.load, and torch.load before 2.9, believe the number of elements that a pickle claims and read past the end of
a shorter member: foreign memory as weights, or a segmentation fault.
"""

from __future__ import annotations

import io
import pickle
import pickletools
import zipfile
from collections import OrderedDict
from pathlib import Path
from typing import Any, NamedTuple

from topokit.inputs.reading import reading

_OF_PICKLES = (AttributeError, LookupError, MemoryError, TypeError, pickle.UnpicklingError)
_BYTES = {
    **dict.fromkeys(("Untyped", "Bool", "Byte", "Char", "QInt8", "QUInt8", "QUInt4x2", "QUInt2x4"), 1),
    **dict.fromkeys(("Half", "BFloat16", "Short"), 2),
    **dict.fromkeys(("Float", "Int", "QInt32"), 4),
    **dict.fromkeys(("Double", "Long", "ComplexFloat"), 8),
    "ComplexDouble": 16,
}  # of an element of a torch.*Storage
_REBUILDS = frozenset({"_rebuild_tensor", "_rebuild_tensor_v2", "_rebuild_tensor_v3", "_rebuild_qtensor"})


def require_storages(path: Path, archive: zipfile.ZipFile, where: str = "") -> None:
    """Refuse archives with tensors that claim more than their member holds.

    Pickles are read without running anything in them: every class and function is replaced by `_Nothing`.

    Args:
        path: the file, for messages.
        archive: the archive; the tensors of its data.pkl and constants.pkl lie in folders of these names. Its other
            pickles (traced inputs, places in the source) are not opened by torch.
        where: what the archive is within the file, for messages.

    Raises:
        ReadError: if a tensor does not fit, or a pickle is malformed.
    """
    sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
    for name in sizes:
        if name.rpartition("/")[2] in ("data.pkl", "constants.pkl"):
            content = archive.read(name)
            with reading(path, f"the pickle {where}{name}", *_OF_PICKLES):
                _require_plain(content)
                _Storages(content, name.removesuffix(".pkl"), sizes).load()


def _require_plain(content: bytes) -> None:
    """A pickle's memo is an array as long as its highest index: up to 64 GiB from nine bytes."""
    for opcode, argument, _ in pickletools.genops(content):
        if opcode.name in ("PUT", "LONG_BINPUT") and (argument or 0) > len(content):
            raise ValueError(f"a memo of {argument} objects in {len(content)} bytes")


class _Storage(NamedTuple):
    name: str
    elements: int


class _Nothing:
    """Stands for any class and for what any function returns."""

    def __init__(self, *_: object) -> None: ...

    def __call__(self, *_: object) -> _Nothing:
        return self

    def __setitem__(self, *_: object) -> None: ...

    def __setstate__(self, _: object) -> None: ...

    def append(self, _: object) -> None: ...

    def extend(self, _: object) -> None: ...


class _Storages(pickle.Unpickler):
    """Reads a pickle for the sizes of its tensors alone."""

    def __init__(self, content: bytes, folder: str, sizes: dict[str, int]) -> None:
        super().__init__(io.BytesIO(content))
        self._folder, self._sizes = folder, sizes

    def find_class(self, module: str, name: str) -> Any:
        if module == "torch" and name.endswith("Storage"):
            return _BYTES[name.removesuffix("Storage")]
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        return _require_extent if name in _REBUILDS else _Nothing

    def persistent_load(self, identity: Any) -> _Storage:
        _, bytes_each, key, _, elements = identity
        name, needed = f"{self._folder}/{key}", elements * bytes_each
        if self._sizes.get(name, -1) < needed:
            raise ValueError(f"{name} should hold {needed} bytes and holds {self._sizes.get(name, 'none')}")
        return _Storage(name, elements)


def _require_extent(storage: _Storage, offset: int, size: tuple[int, ...], stride: tuple[int, ...], *_: object) -> None:
    last = offset + sum((length - 1) * step for length, step in zip(size, stride, strict=True))
    if min((offset, *size, *stride), default=0) < 0 or (0 not in size and last >= storage.elements):
        raise ValueError(f"a tensor of size {size}, stride {stride}, in {storage.elements} elements of {storage.name}")
