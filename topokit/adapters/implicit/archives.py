"""Archives of networks: what in them may be opened.

torch.export.load runs pickles and machine code; torch.jit.load reads past the end of members that are too short.
"""

from __future__ import annotations

import io
import os
import pickle
import re
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from topokit.adapters.implicit.storages import require_storages
from topokit.errors import ReadError
from topokit.inputs.reading import reading, require_members

_MACHINE_CODE = "data/aotinductor/"  # shared libraries of AOTInductor, which are loaded into the process
_OBJECTS = ("opaque_obj_", "custom_obj_")  # constants that are pickled Python objects, or objects of C++ classes
_PICKLED = re.compile(
    r"\.pt$|serialized_(state_dict|constants|example_inputs)\."
)  # members that are files of torch.save
_OF_PICKLES = (AttributeError, EOFError, LookupError, RuntimeError, TypeError, ValueError, pickle.UnpicklingError)
_FORCED = "TORCH_FORCE_WEIGHTS_ONLY_LOAD"  # torch's own variable


def safe_copy(path: Path, exported: bool) -> io.BytesIO:
    """The archive with the members that were checked, and with nothing else, whatever another reader would find in it.

    Args:
        path: a TorchScript archive, or one of torch.export.
        exported: whether it is of torch.export, whose pickles must be of tensors alone.

    Raises:
        ReadError: if it is damaged, expands absurdly, holds a tensor larger than its member, or, if it is of
            torch.export, machine code or a pickle of more than tensors.
    """
    target = io.BytesIO()
    with (
        reading(path, "zipfile", NotImplementedError, RuntimeError),
        zipfile.ZipFile(path) as archive,
        zipfile.ZipFile(target, "w") as copy,
    ):
        entries = archive.infolist()
        require_members(path, entries)
        names = [entry.filename for entry in entries]
        if len(set(names)) < len(names):
            raise ReadError(f"{path} holds two members of one name: it is damaged, or made to mislead.")
        for entry in entries:
            content = archive.read(entry)
            if exported:
                _check_member(path, entry.filename, content)
            copy.writestr(entry.filename, content)
        require_storages(path, copy)
    target.seek(0)
    return target


@contextmanager
def weights_only() -> Iterator[None]:
    """During the block `torch.load` opens tensors alone, whatever its caller asks for."""
    before = os.environ.get(_FORCED)
    os.environ[_FORCED] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_FORCED]
        else:
            os.environ[_FORCED] = before


def _check_member(path: Path, name: str, content: bytes) -> None:
    advice = "Save the network by torch.export.save, with weights alone beside its graph."
    if _MACHINE_CODE in name:
        raise ReadError(f"{path} holds machine code ({name}), which is not run. {advice}")
    may_run = "which may run any code when it is opened"
    if any(kind in name for kind in _OBJECTS):
        raise ReadError(f"{path} holds a pickled object ({name}), {may_run}. {advice}")
    if _PICKLED.search(name) and content:
        if zipfile.is_zipfile(io.BytesIO(content)):
            with zipfile.ZipFile(io.BytesIO(content)) as saved:
                require_storages(path, saved, f"{name}/")
        try:
            torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
        except _OF_PICKLES as error:
            raise ReadError(f"{path} holds a pickle of more than tensors ({name}), {may_run}. {advice}") from error
