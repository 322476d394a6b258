"""Networks from files that hold a program, not a pickle: TorchScript and torch.export archives."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import cast

import torch

from topokit.adapters.implicit.function import Function
from topokit.errors import ReadError
from topokit.inputs.reading import reading

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

    Pickles are refused: opening one runs whatever code it names.

    Args:
        path: an existing file.

    Raises:
        ReadError: if it is a pickle, no archive at all, or malformed.
    """
    kind = archive_kind(path)
    if kind == "script":
        with reading(path, "torch.jit.load", RuntimeError):
            return cast(Function, torch.jit.load(path, map_location="cpu"))
    if kind == "export":
        with reading(path, "torch.export.load", AttributeError, LookupError, RuntimeError, TypeError):
            return cast(Function, torch.export.load(path).module())
    if kind == "pickle":
        raise ReadError(
            f"{path} is a Python pickle (torch.save), which may run any code when it is opened. {_HOW} {_SPLATS}"
        )
    raise ReadError(f"{path} is neither a TorchScript nor a torch.export archive. {_HOW}")


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
