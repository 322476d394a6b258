"""How networks are recognized, without importing torch."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from topokit.inputs.files import ZIP, head, member_names
from topokit.plugins.adapter import Adapter

_SENTENCE = (
    "A checkpoint of torch.save is no network, but a pickle of tensors: for one of Gaussian splats use "
    "topokit.from_splats(torch.load(path, weights_only=True))."
)
_FINE = 1024  # cells along the longest side
_SUFFIXES = (".pt", ".pth", ".pt2", ".ts")
_MEMBERS = re.compile(r"(^|/)((data|constants)\.pkl|archive_format|serialized_exported_program\.json)$")


def is_network(source: Path) -> bool:
    """Whether the content is an archive of torch: a program, or a pickle."""
    start = head(source)
    if not start.startswith(ZIP):
        return False
    names = member_names(source)
    return b".pkl" in start if names is None else any(map(_MEMBERS.search, names))


def is_fine(source: Path, options: Mapping[str, Any]) -> bool:
    """Whether the finest grid of a network is one that several workers should share."""
    return int(options.get("resolution") or 0) >= _FINE


SDF = Adapter(
    name="sdf",
    description="signed distance networks saved by torch.jit or torch.export",
    suffixes=_SUFFIXES,
    can_open=is_network,
    runs_code=_SENTENCE,
    opener="topokit.adapters.implicit.adapter:from_sdf",
    is_large=is_fine,
)
OCCUPANCY = Adapter(
    name="occupancy",
    description="occupancy networks saved likewise",
    suffixes=_SUFFIXES,
    can_open=is_network,
    runs_code=_SENTENCE,
    opener="topokit.adapters.implicit.adapter:from_occupancy",
    is_large=is_fine,
)
