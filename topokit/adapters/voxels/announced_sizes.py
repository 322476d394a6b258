"""What the header of a volume announces, held against the file before memory is allocated for it."""

from __future__ import annotations

import bz2
import gzip
import math
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, Literal

from topokit.errors import ReadError
from topokit.inputs.files import file_beside
from topokit.inputs.size_limits import FREE_OF_MASKS, most_expanded, require_bytes, require_expansion

_STEP = 1 << 20
_BIG_TIFF = 43  # version of the format with offsets of eight bytes


def check_nibabel(path: Path, image: Any, n_bytes: int) -> None:
    """Refuse an image of nibabel, not read yet, with more voxels than there are bytes.

    Raises:
        ReadError: if it has.
    """
    needed = math.prod(map(int, image.shape)) * image.header.get_data_dtype().itemsize
    require_bytes(path, f"an image of shape {image.shape}", needed, n_bytes)


def page_count(path: Path, most: int | None = None) -> int:
    """Pages of a .tif, or the given number if there are more; other files have a few, too.

    Raises:
        ReadError: if the pages follow each other in a circle, which tifffile would go around for ever.
    """
    with path.open("rb") as file:
        start = file.read(16)
        order: Literal["little", "big"] = "little" if start.startswith(b"II") else "big"
        is_big = int.from_bytes(start[2:4], order) == _BIG_TIFF
        count_size, entry_size, offset_size = (8, 20, 8) if is_big else (2, 12, 4)
        offset = int.from_bytes(start[8:16] if is_big else start[4:8], order)
        seen, size = set[int](), path.stat().st_size
        while offset and offset not in seen and (most is None or len(seen) < most):
            seen.add(offset)
            file.seek(min(offset, size))
            n_entries = int.from_bytes(file.read(count_size), order)
            file.seek(min(offset + count_size + entry_size * n_entries, size))
            offset = int.from_bytes(file.read(offset_size), order)
    if offset in seen:
        raise ReadError(f"{path}: after its {len(seen)} pages the one at byte {offset} comes again: it is damaged.")
    return len(seen)


def check_tiff(path: Path, file: Any) -> None:
    """Refuse a file of tifffile, not read yet, whose pages are larger than their bytes can be.

    Raises:
        ReadError: if they are.
    """
    for series in file.series[:1]:
        pages = [page for page in series.pages if page is not None]
        is_plain = all(getattr(page, "compression", 0) == 1 for page in pages)
        longest = max((length for page in pages for length in getattr(page, "databytecounts", ())), default=0)
        require_bytes(path, "a strip of pixels", longest, path.stat().st_size)
        n_strips = max((math.prod(getattr(page, "chunked", ())) for page in pages), default=0)
        require_bytes(path, f"{n_strips} strips of pixels", n_strips, path.stat().st_size)
        if is_plain:
            require_bytes(path, f"pages of shape {series.shape}", series.nbytes, path.stat().st_size)
        else:
            require_expansion(path, series.nbytes, path.stat().st_size, FREE_OF_MASKS)


def check_chunks(name: Path | str, announced: int, chunk: int, stored: int, packed: int) -> None:
    """Refuse an array that announces far more than is stored of it: chunks that are missing have its fill value.

    Args:
        name: what to call it.
        announced: bytes of all its values.
        chunk: bytes of the values that are decompressed together.
        stored: bytes of the values in the chunks that are stored.
        packed: bytes that these chunks have in the file.

    Raises:
        ReadError: if a chunk takes more than 256 MiB and 200 times what is stored, or the array more than 256 MiB and
            200 times what the stored chunks hold.
    """
    for what, needed, held in (("a chunk", chunk, packed), ("an array", announced, stored)):
        if needed > most_expanded(held):
            raise ReadError(
                f"{name} announces {what} of {needed} bytes and stores {held} bytes for it; 256 MiB or 200 times that "
                "are read. Its header is wrong or made to exhaust memory or time; if you know better, open it with its "
                "own library and pass the array."
            )


def check_nrrd(path: Path) -> None:
    """Refuse a file that names another one outside its folder, or whose compressed voxels expand absurdly.

    Raises:
        ReadError: if it does.
    """
    import nrrd

    with path.open("rb") as file:
        header = nrrd.read_header(file)
        if "data file" in header and "datafile" in header:
            raise ReadError(f"{path} says twice where its voxels are, as 'data file' and as 'datafile'.")
        elsewhere = header.get("data file", header.get("datafile"))
        place = path if elsewhere is None else file_beside(path, str(elsewhere))
        start = file.tell() if elsewhere is None else 0
    unpack = _UNPACKERS.get(str(header.get("encoding")))
    if unpack is None:
        return
    with place.open("rb") as file:
        file.seek(start)
        for _ in range(min(place.stat().st_size, int(header.get("line skip", header.get("lineskip", 0))))):
            file.readline()
        n_unpacked = 0
        for length in _unpacked_lengths(unpack(file)):
            n_unpacked += length
            require_expansion(path, n_unpacked, place.stat().st_size, FREE_OF_MASKS)


def _unpacked_lengths(unpacked: Any) -> Iterator[int]:
    """Lengths of the parts of a stream; a damaged one just ends, as its reader says what is wrong."""
    while True:
        try:
            part = unpacked.read(_STEP)
        except (OSError, EOFError, zlib.error):
            return
        if not part:
            return
        yield len(part)


_UNPACKERS: dict[str, Callable[[BinaryIO], Any]] = {
    **dict.fromkeys(("gzip", "gz"), lambda file: gzip.GzipFile(fileobj=file)),
    **dict.fromkeys(("bzip2", "bz2"), bz2.BZ2File),
}
