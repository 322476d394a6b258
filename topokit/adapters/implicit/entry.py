"""How networks are recognised, without importing torch."""

from __future__ import annotations

from pathlib import Path

from topokit.inputs.files import ZIP, head
from topokit.plugins.adapter import Adapter


class Sdf(Adapter):
    """Signed distance networks; see `topokit.from_sdf`."""

    name = "sdf"
    description = "signed distance networks saved by torch.jit or torch.export"
    suffixes = (".pt", ".pth", ".pt2", ".ts")
    opener = "topokit.adapters.implicit.adapter:from_sdf"

    def can_open(self, source: Path) -> bool:
        start = head(source)
        return start.startswith(ZIP) and b".pkl" in start


class Occupancy(Adapter):
    """Occupancy networks, whose files look like those of distance networks: by name only; see `from_occupancy`."""

    name = "occupancy"
    description = 'occupancy networks, saved as above; load(path, adapter="occupancy")'
    suffixes = ()
    opener = "topokit.adapters.implicit.adapter:from_occupancy"
