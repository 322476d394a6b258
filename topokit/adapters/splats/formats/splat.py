"""The headerless .splat: 32 bytes per splat."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from topokit.adapters.splats.formats.splat_table import SplatTable
from topokit.errors import ReadError

ROW = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 4), ("rotation", "u1", 4)])


def read_splat(path: Path) -> SplatTable:
    """Splats of a .splat file: linear scales, opacity in the fourth color byte, rotation bytes (q + 1)·128.

    Raises:
        ReadError: if the size is not a multiple of 32, or if most rows cannot be splats.

    Reference:
        https://github.com/antimatter15/splat
    """
    size = path.stat().st_size
    if size % ROW.itemsize:
        raise ReadError(
            f"{path} has {size} bytes, {size % ROW.itemsize} more than whole splats of {ROW.itemsize} bytes: "
            "it is truncated or not a .splat file."
        )
    rows = np.fromfile(path, dtype=ROW)
    plausible = np.isfinite(rows["mean"]).all(axis=1) & np.isfinite(rows["scale"]).all(axis=1)
    plausible &= (rows["scale"] >= 0).all(axis=1) & (rows["scale"] > 0).any(axis=1)
    if 2 * int(plausible.sum()) < len(rows):
        raise ReadError(
            f"{path}: {len(rows) - int(plausible.sum())} of {len(rows)} rows have positions or scales that are not "
            "finite and positive; this is not a .splat file, or it is damaged."
        )
    return SplatTable(
        rows["mean"].copy(),
        rows["scale"].copy(),
        (rows["rotation"].astype(np.float32) - 128) / np.float32(128),
        rows["color"][:, 3].astype(np.float32) / np.float32(255),
    )
