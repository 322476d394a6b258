"""Writing files: under another name beside the target, which is replaced when the new file is complete."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from topokit.ending import finally_do
from topokit.errors import InputError, TopokitError


@contextmanager
def completed_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """The path of an unfinished file, which takes the place of the target when the block is left without an error.

    Until then the target stays as it is, or missing. After an error or a signal the unfinished file is removed. Links
    are followed, permissions of a file that is replaced are kept, and what is no file, such as a pipe, is written
    directly.

    Args:
        path: file to write, in a folder that exists.

    Raises:
        InputError: if the folder cannot be written to, or the disk is full.
    """
    target = Path(os.path.realpath(path))
    try:
        if target.exists() and not target.is_file():
            yield target
            return
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.stem}-", suffix=f".part{target.suffix}")
        os.close(handle)
        unfinished = Path(name)
        with finally_do(partial(_remove, unfinished)):
            yield unfinished
            if target.exists():
                shutil.copymode(target, unfinished)
            else:
                unfinished.chmod(0o666 & ~_umask())
            os.replace(unfinished, target)
    except (TopokitError, BrokenPipeError):  # the pipe is another output, which somebody closed
        raise
    except OSError as error:
        raise InputError(f"{path} could not be written ({error.strerror or error}).") from error


def _remove(path: Path) -> None:
    with suppress(OSError):  # Windows keeps files that are open
        path.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
