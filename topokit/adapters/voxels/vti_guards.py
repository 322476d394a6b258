"""Guards around VTK's reader of images, which leaves values undefined, prints errors and ends the process."""

from __future__ import annotations

import binascii
import math
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from topokit.inputs.size_limits import FREE_OF_MASKS, require_bytes, require_expansion

_ONE_AT_A_TIME = threading.Lock()  # where VTK writes its errors is a matter of the process
_FIELDS = ("PointData", "CellData")
_TAG = 1 << 16  # bytes in which the tag of an array ends


def checked_cells(path: Path) -> int:
    """The number of cells in all pieces of an image, whose compressed arrays announce no absurd sizes.

    VTK leaves values undefined where there is no piece, and ends the process if memory for blocks cannot be had.

    Raises:
        ReadError: if a compressed array announces more than the file can hold.
        ValueError: if the file is malformed.
    """
    from vtkmodules.vtkIOXMLParser import vtkXMLDataParser

    parser, n_cells = vtkXMLDataParser(), 0
    with errors_raised():
        parser.SetFileName(str(path))
        parser.Parse()
    root = parser.GetRootElement()
    for piece in _nested(root.FindNestedElementWithName("ImageData"), "Piece"):
        ends = np.array((piece.GetAttribute("Extent") or "").split(), dtype=int).reshape(3, 2)
        n_cells += math.prod(np.maximum(1, np.diff(ends)).ravel().tolist())
        for array in (one for field in _FIELDS for data in _nested(piece, field) for one in _nested(data, "DataArray")):
            if root.GetAttribute("compressor") and array.GetAttribute("format") != "ascii":
                _check_blocks(path, root, array, parser.GetAppendedDataPosition())
    return n_cells


def _nested(element: Any, name: str) -> Iterator[Any]:
    for number in range(element.GetNumberOfNestedElements()):
        found = element.GetNestedElement(number)
        if found.GetName() == name:
            yield found


def _check_blocks(path: Path, root: Any, array: Any, appended: int) -> None:
    """Refuse a compressed array with absurd sizes in the words that it begins with.

    These are the number of blocks, the bytes of each and of the last one, and the compressed bytes of each.
    """
    size = path.stat().st_size
    word = np.dtype("u8" if root.GetAttribute("header_type") == "UInt64" else "u4")
    word = word.newbyteorder("big" if root.GetAttribute("byte_order") == "BigEndian" else "little")
    data = next(_nested(root, "AppendedData"), None)
    with path.open("rb") as file:
        if array.GetAttribute("format") == "appended":
            is_raw, start = data is not None and data.GetAttribute("encoding") == "raw", appended
            start += int(array.GetAttribute("offset") or "")
        else:
            is_raw, start = False, array.GetXMLByteIndex()
            file.seek(start)
            tag, _, rest = file.read(_TAG).partition(b">")
            start += len(tag) + 1 + len(rest) - len(rest.lstrip())

        def words(count: int) -> list[int]:
            n_bytes = count * word.itemsize
            file.seek(start)
            found = file.read(n_bytes) if is_raw else binascii.a2b_base64(file.read(-(-n_bytes // 3) * 4))
            return np.frombuffer(found, word, count).tolist()

        n_blocks, of_each, of_last = words(3)
        require_bytes(path, f"{n_blocks} compressed blocks", n_blocks * word.itemsize, size)
        require_bytes(path, "compressed blocks", sum(words(3 + n_blocks)[3:]), size)
    require_expansion(path, n_blocks * max(of_each, of_last), size, FREE_OF_MASKS)


@contextmanager
def errors_raised() -> Iterator[None]:
    """Raise what VTK would print as a `ValueError`; it has no exceptions and goes on after errors."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    told = vtkStringOutputWindow()
    with _ONE_AT_A_TIME:
        before, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
        vtkOutputWindow.SetInstance(told)
        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
        try:
            yield
        finally:
            vtkOutputWindow.SetInstance(before)
            vtkLogger.SetStderrVerbosity(verbosity)
    errors = re.findall(r"^ERROR: .*\n\S+ \(0x\w+\): (.*)", told.GetOutput(), re.MULTILINE)
    if errors:
        raise ValueError(errors[0])
