"""Archives of networks: what in them may be opened.

torch.export.load runs pickles and machine code; torch.jit.load reads past the end of members that are too short. What
is refused here keeps accidents and simple traps away. It does not make a program harmless.
"""

from __future__ import annotations

import io
import json
import pickle
import re
import zipfile
from pathlib import Path

import torch

from topokit.adapters.implicit.storages import require_storages
from topokit.errors import ReadError
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_members

_CONFIG = "_config.json"  # which members are weights or constants, and which of them are pickles
_MACHINE_CODE = "data/aotinductor/"  # shared libraries of AOTInductor, which are loaded into the process
_OBJECTS = ("opaque_obj_", "custom_obj_")  # constants that are pickled Python objects, or objects of C++ classes
_PICKLED = re.compile(
    r"\.pt$|serialized_(state_dict|constants|example_inputs)\."
)  # members that are files of torch.save
_OF_PICKLES = (AttributeError, EOFError, LookupError, RuntimeError, TypeError, ValueError, pickle.UnpicklingError)


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
        names = [entry.filename.lower() for entry in entries]  # torch looks members up whatever their case
        if len(set(names)) < len(names):
            raise ReadError(f"{path} holds two members of one name: it is damaged, or made to mislead.")
        for entry in entries:
            content = archive.read(entry)
            if exported:
                _check_member(path, entry.filename.lower(), content)
            copy.writestr(entry.filename, content)
        require_storages(path, copy)
    target.seek(0)
    return target


def _check_member(path: Path, name: str, content: bytes) -> None:
    """Refuse a member of an archive of torch.export, its name in lower case, that would run while it is opened."""
    advice = "Save the network by torch.export.save, with weights alone beside its graph."
    if _MACHINE_CODE in name:
        raise ReadError(f"{path} holds machine code ({name}), which is not run. {advice}")
    may_run = "which may run any code when it is opened"
    if any(kind in name for kind in _OBJECTS) or (name.endswith(_CONFIG) and _names_pickles(content)):
        raise ReadError(f"{path} holds a pickled object ({name}), {may_run}. {advice}")
    if _PICKLED.search(name) and content:
        if zipfile.is_zipfile(io.BytesIO(content)):
            with zipfile.ZipFile(io.BytesIO(content)) as saved:
                require_storages(path, saved, f"{name}/")
        try:
            torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
        except _OF_PICKLES as error:
            raise ReadError(f"{path} holds a pickle of more than tensors ({name}), {may_run}. {advice}") from error


def _names_pickles(config: bytes) -> bool:
    """Whether a list of weights or constants says of one that it is a pickle, which torch opens without restriction."""
    found = json.loads(config)
    entries = found.get("config") if isinstance(found, dict) else None
    values = entries.values() if isinstance(entries, dict) else ()
    return any(isinstance(entry, dict) and entry.get("use_pickle") for entry in values)
