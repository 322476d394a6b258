"""Reading damaged files: what each ends in, how long it takes, and what counts as a bug of ours."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from topokit.errors import AdapterError, ReadError, TopokitError

SLOW = 10.0  # s of CPU time for one file


@dataclass
class Outcome:
    """What reading many damaged files ended in.

    Attributes:
        messages: number of files by the beginning of the message, without names and numbers; "read" for those read.
        bugs: content of files on which a reader raised something else than an error about a file, by what it was.
        slowest: CPU seconds of the slowest file.
    """

    messages: Counter[str] = field(default_factory=Counter)
    bugs: dict[str, bytes] = field(default_factory=dict)
    slowest: float = 0.0


def reader_of(name: str) -> Callable[[Path], Any]:
    """The reader of a format."""
    from intact_files import FLAT

    if name in ("TorchScript", "torch.export"):
        from topokit import load

        return lambda path: load(path, adapter="sdf")  # which calls it, and so reads its weights
    if name in ("sog", "spz", "spz 4", "splat", "ksplat", "compressed ply") or name.startswith("3dgs"):
        from topokit.adapters.splats.formats.read_splats import read_splats

        return read_splats
    if name in ("glb", "gltf", "3mf", "gifti", "freesurfer", *list(FLAT)[:6]):
        from topokit.adapters.mesh.files import read_mesh

        return read_mesh
    if name == "vti":
        return _read_stored
    if name == "nii.gz":
        return _read_packed
    if "volume" in name or name.startswith(("nii", "nrrd", "tif", "mgh", "mrc")):
        from topokit.adapters.voxels.files import read_volume

        return read_volume
    from topokit.adapters.points.files import read_points

    return read_points


def _read_packed(path: Path) -> Any:
    """A gzipped volume, unpacked as `topokit.load` does it."""
    from topokit.adapters.voxels.files import read_volume
    from topokit.inputs.unpacking import unpacked

    with unpacked(path) as plain:
        return read_volume(plain)


def _read_stored(path: Path) -> Any:
    """A volume that can be read box by box, as a whole."""
    from topokit.adapters.voxels.opening_stored import stored_volume

    found = stored_volume(path)
    if found is None:
        raise ReadError(f"{path} is not recognized any more")
    return found.whole()


def read_all(files: Iterable[bytes], path: Path, read: Callable[[Path], Any]) -> Outcome:
    """Read files one after the other under the same name."""
    outcome = Outcome()
    for content in files:
        path.write_bytes(content)
        started = time.process_time()
        kind, is_bug = how_it_ends(path, read)
        seconds = time.process_time() - started
        outcome.messages[kind] += 1
        outcome.slowest = max(outcome.slowest, seconds)
        if is_bug or seconds > SLOW:
            outcome.bugs.setdefault(kind if is_bug else f"{seconds:.0f} s", content)
    return outcome


def how_it_ends(path: Path, read: Callable[[Path], Any]) -> tuple[str, bool]:
    """What reading a file ends in, in short, and whether that is a bug.

    Bugs are exceptions that are no `TopokitError`, an `AdapterError` (which wraps them), and a failed allocation that
    is called a damaged file.
    """
    try:
        read(path)
    except TopokitError as error:
        is_bug = isinstance(error, AdapterError) or isinstance(error.__cause__, MemoryError)
        return _shortened(str(error), path), is_bug
    except Exception as error:  # noqa: BLE001 (whatever it is, it is the bug that is looked for)
        return f"{type(error).__name__}: {_shortened(str(error), path)}", True
    return "read", False


def _shortened(message: str, path: Path) -> str:
    words = message.replace(str(path), "FILE").split()
    return " ".join("N" if any(letter.isdigit() for letter in word) else word for word in words)[:110]
