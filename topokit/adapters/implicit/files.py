"""Networks from files that hold a program, not a pickle: TorchScript and torch.export archives."""

from __future__ import annotations

import pickle
import threading
import zipfile
from pathlib import Path
from typing import cast

import torch

from topokit.adapters.implicit.archives import safe_copy
from topokit.adapters.implicit.function import Function
from topokit.errors import ReadError
from topokit.inputs.reading import quiet, reading

_ONE_AT_A_TIME = threading.Lock()  # torch.export.load keeps what it is doing in a global variable
_HOW = (
    "For a network, save it as a program: torch.jit.save(torch.jit.trace(net, points), path) or "
    "torch.export.save(torch.export.export(net, (points,), dynamic_shapes=...), path)."
)
_SPLATS = (
    "For a checkpoint of Gaussian splats (gsplat, nerfstudio), pass its dictionary: "
    "topokit.from_splats(torch.load(path, weights_only=True))."
)


def read_network(path: Path) -> Function:
    """The function stored in a TorchScript or torch.export archive.

    Both are programs and can do whatever torch can, such as reading and writing files: open only those of people whose
    programs you would run. Pickles, which run any code while they are opened, are refused, and those within archives,
    too; so is machine code.

    Args:
        path: an existing file.

    Raises:
        ReadError: if it is a pickle, holds one or machine code, is no archive at all, or is malformed.
    """
    kind = archive_kind(path)
    if kind == "script":
        archive = safe_copy(path, exported=False)
        with reading(path, "torch.jit.load", LookupError, RuntimeError):
            return cast(Function, torch.jit.load(archive, map_location="cpu"))
    if kind == "export":
        archive = safe_copy(path, exported=True)
        with _ONE_AT_A_TIME, quiet("torch.export"), reading(path, "torch.export.load", *_of_export()):
            return cast(Function, torch.export.load(archive).module())
    if kind == "pickle":
        raise ReadError(
            f"{path} is a Python pickle (torch.save), which may run any code when it is opened. {_HOW} {_SPLATS}"
        )
    raise ReadError(f"{path} is neither a TorchScript nor a torch.export archive. {_HOW}")


def _of_export() -> tuple[type[Exception], ...]:
    """What torch.export raises on damaged archives, beside ValueError and the like."""
    from torch._export.verifier import SpecViolationError  # not imported before it is needed: it takes a second

    return (
        AssertionError,
        AttributeError,
        LookupError,
        RuntimeError,
        SyntaxError,
        TypeError,
        pickle.UnpicklingError,
        SpecViolationError,
    )


def archive_kind(path: Path) -> str | None:
    """ "script", "export", "pickle", or None for something else, by the names in the archive."""
    if not zipfile.is_zipfile(path):
        with path.open("rb") as file:
            return "pickle" if file.read(1) == b"\x80" else None
    with reading(path, "zipfile", NotImplementedError), zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    inner = {name.partition("/")[2] for name in names}
    if any("serialized_exported_program" in name or name.startswith("models/") for name in {*names, *inner}):
        return "export"
    if "constants.pkl" in inner and any(name.startswith("code/") for name in inner):
        return "script"
    return "pickle" if "data.pkl" in inner else None
