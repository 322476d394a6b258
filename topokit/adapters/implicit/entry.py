"""How networks are recognized, without importing torch."""

from __future__ import annotations

from pathlib import Path

from topokit.inputs.files import ZIP, head
from topokit.plugins.adapter import Adapter


def is_network(source: Path) -> bool:
    """Whether the content is an archive of torch."""
    start = head(source)
    return start.startswith(ZIP) and b".pkl" in start


SDF = Adapter(
    name="sdf",
    description="signed distance networks saved by torch.jit or torch.export",
    suffixes=(".pt", ".pth", ".pt2", ".ts"),
    can_open=is_network,
    opener="topokit.adapters.implicit.adapter:from_sdf",
)
OCCUPANCY = Adapter(
    name="occupancy",
    description='occupancy networks; their files look like those of "sdf", so name them: adapter="occupancy"',
    suffixes=(),
    opener="topokit.adapters.implicit.adapter:from_occupancy",
)
